"""Data sets on disk and in memory: frames, regions, ground, split, and runs of the simulator."""
