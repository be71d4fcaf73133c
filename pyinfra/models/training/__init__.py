"""How detectors learn: recipes, samples, sources of frames, checkpoints."""
