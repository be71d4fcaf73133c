"""Learning a detector's weights from frames, and what is kept of it."""
