"""Tests the paper's claims with confidence intervals; docs/conventions.md defines the rules."""
