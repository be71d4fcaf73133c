"""Tests the paper's claims with intervals; docs/verdict_rules.md defines the rules."""
