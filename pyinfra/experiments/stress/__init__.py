"""Detectors under faults of growing severity."""
