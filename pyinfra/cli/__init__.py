"""The `pyinfra` command: one module for each subcommand."""
