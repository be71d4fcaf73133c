"""Makes tables of the documentation, one module per topic."""
