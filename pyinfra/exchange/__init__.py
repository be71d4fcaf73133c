"""Frames for other tools: one module per format, each with `export`."""
