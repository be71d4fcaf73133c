"""Shows frames in 3-D as one HTML file."""
