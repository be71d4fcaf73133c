"""Detectors, training, inference and the pretrained detector."""
