"""Tests the paper's claims with intervals; docs/conventions/claims.md defines the rules."""
