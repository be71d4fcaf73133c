"""The measurements behind the detectability of `pyinfra plan`: its fit and its check."""
