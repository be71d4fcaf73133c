"""Makes the tables of the documentation; each module covers one topic."""
