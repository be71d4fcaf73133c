"""Plans where LiDARs stand: candidates, what they see, what a detector finds, choice and check."""
