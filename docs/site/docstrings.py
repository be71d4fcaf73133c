"""Joins wrapped descriptions of docstrings before numpydoc reads them.

numpydoc takes the first line of `name : text` for a type and shows the next lines apart. Each line
of a return value without a name is a value of its own to it.
"""

import re
from typing import Any

from sphinx.application import Sphinx

ITEM = re.compile(r"\w[\w, ]* : ")
REST = re.compile(r" {4}[^\s-]")
TEXT = re.compile(r"[^\s-]")


def joined(lines: list[str]) -> list[str]:
    result: list[str] = []
    returns = False  # whether the section is that of the return value
    for line in lines:
        before = result[-1] if result else ""
        if set(line) == {"-"}:
            returns = before == "Returns"
        goes_on = returns and before.strip("-") and TEXT.match(line) and not ITEM.match(line)
        if goes_on or (ITEM.match(before) and REST.match(line)):
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
