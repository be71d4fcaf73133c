"""Benchmarks and stress tests, their tables, and the recommendation."""
