"""Runs a trained CenterPoint on pillars with ONNX Runtime, without PyTorch."""
