"""The `infrasim` binary, and what comes with it."""
