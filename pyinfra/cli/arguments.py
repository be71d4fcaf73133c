"""Passes the options of a command to the function of the public API that the command calls."""

import argparse
import inspect
from collections.abc import Callable
from typing import Any


def arguments_of(function: Callable[..., Any], args: argparse.Namespace) -> dict[str, Any]:
    """Returns those options of a command line that are arguments of a function, by name."""
    names = inspect.signature(function).parameters
    return {name: value for name, value in vars(args).items() if name in names}
