"""Random scenes: roads, what stands beside them, people and LiDARs, by seed."""
