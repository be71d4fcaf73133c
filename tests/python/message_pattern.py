"""Patterns of error messages."""

import re


def pattern(message: str) -> str:
    """Returns the regular expression of a message, in which `...` stands for any text."""
    return re.escape(message).replace(r"\.\.\.", ".*")
