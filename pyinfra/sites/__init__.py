"""Plausible sites by the thousand, and training that streams from the simulator in them."""
