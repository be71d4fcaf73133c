"""Runs detectors on frames, and filters, checks and writes their boxes."""
