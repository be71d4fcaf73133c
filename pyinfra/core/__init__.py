"""Arrays, boxes, files that appear whole, the reader of configurations."""
