"""Data sets on disk and in memory: frames, regions, ground, split, and the simulator's runs."""
