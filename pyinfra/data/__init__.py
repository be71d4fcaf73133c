"""Tables over many frames of a data set, and its roads."""
