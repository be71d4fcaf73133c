"""Plans positions of LiDARs: lists poses, observes objects, predicts recall, chooses and checks."""
