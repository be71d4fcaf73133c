"""An interactive 3-D view of frames of several LiDARs as HTML that needs no network."""
