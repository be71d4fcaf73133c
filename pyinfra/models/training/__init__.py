"""Training of detectors: recipes, samples, sources of frames, checkpoints."""
