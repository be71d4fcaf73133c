"""Draws pictures, plots, site plans, the 3-D viewer and the report."""
