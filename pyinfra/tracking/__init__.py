"""Boxes to tracks, and tracks to counts, speeds and travel times."""
