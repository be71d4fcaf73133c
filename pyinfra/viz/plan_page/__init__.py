"""The page of a plan: answer, controls, map, charts and evidence in one HTML file."""
