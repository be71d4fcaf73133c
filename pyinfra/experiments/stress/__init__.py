"""Stress tests: detectors under faults of growing severity."""
