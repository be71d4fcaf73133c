"""Joins wrapped descriptions of docstrings before numpydoc reads them.

numpydoc takes the first line of `name : text` for a type and shows the next lines apart.
"""

import re
from typing import Any

from sphinx.application import Sphinx

ITEM = re.compile(r"\w[\w, ]* : ")
REST = re.compile(r" {4}[^\s-]")


def joined(lines: list[str]) -> list[str]:
    result: list[str] = []
    for line in lines:
        if result and ITEM.match(result[-1]) and REST.match(line):
            result[-1] += f" {line.strip()}"
        else:
            result.append(line)
    return result


def join_items(
    app: Sphinx, what: str, name: str, value: object, options: Any, lines: list[str]
) -> None:
    lines[:] = joined(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", join_items, priority=100)  # numpydoc: 500
    return {"parallel_read_safe": True}
