"""The paper's claims as tests with intervals; docs/conventions.md defines the rules."""
