"""Frames for other tools, and other tools' frames as data sets."""
