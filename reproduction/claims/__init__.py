"""The claims of the paper, as tests with intervals; the rules stand in docs/conventions.md."""
