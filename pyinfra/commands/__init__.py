"""One module for each subcommand of `pyinfra`."""
