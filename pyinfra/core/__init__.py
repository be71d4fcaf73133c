"""Array types, boxes, atomic file writing and the reader of configurations."""
