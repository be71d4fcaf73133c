"""Random scenes by seed: roads, roadside objects, pedestrians, cyclists and LiDARs."""
