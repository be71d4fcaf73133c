"""Passes the options of a command to the function of the public API that it calls."""

import argparse
import inspect
from collections.abc import Callable
from typing import Any


def arguments_of(function: Callable[..., Any], args: argparse.Namespace) -> dict[str, Any]:
    """Returns the values of a command line that have the names of a function's arguments."""
    names = inspect.signature(function).parameters
    return {name: value for name, value in vars(args).items() if name in names}
