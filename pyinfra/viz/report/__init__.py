"""Shows the results as one HTML page."""
