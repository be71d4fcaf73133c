"""Many experiments: scene, LiDAR, preset, detector and seed."""
