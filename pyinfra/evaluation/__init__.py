"""From predictions and ground truth to average precision, with intervals."""
