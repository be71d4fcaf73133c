"""Hits, points per vehicle, quality classes and patterns of data sets."""
