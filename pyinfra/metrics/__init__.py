"""Matching, average precision, points per vehicle, intervals and comparisons."""
