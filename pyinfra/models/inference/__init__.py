"""How detectors find boxes in frames, and what is done with the boxes afterwards."""
