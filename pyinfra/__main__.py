"""`python -m pyinfra` is the `pyinfra` command."""

import sys

from pyinfra.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
