"""Scene x LiDAR x preset x detector x seed: every cell a row that can be repeated."""
