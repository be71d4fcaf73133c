"""Benchmarks: experiments over scenes, LiDARs, presets, detectors and seeds."""
