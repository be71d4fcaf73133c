"""A YAML reader whose errors name file, line and key."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import yaml

from pyinfra.core.config import MOST_BYTES, NO_VALUE, compose
from pyinfra.core.errors import FormatError
from pyinfra.core.files import check_size
from pyinfra.formats.text_table import lines_of


def read_yaml(file: Path) -> "YamlNode":
    """Returns the root node of a YAML file. Raises FormatError with file and line."""
    return YamlNode(file, _parsed(file, compose), "")


def parse_yaml(text: str, name: str) -> "YamlNode":
    """Returns the root node of a YAML text. Messages show `name` as the file.

    Raises yaml.YAMLError if the text is not YAML.
    """
    return YamlNode(Path(name), compose(text), "")


def read_keys(file: Path) -> dict[str, Any]:
    """Returns all keys and values of a YAML file. Raises FormatError with file and line."""
    _parsed(file, compose)  # `compose` gives more precise error messages than `safe_load`
    parsed = _parsed(file, yaml.safe_load)
    if not isinstance(parsed, dict):
        got = "a list" if isinstance(parsed, list) else f"'{str(parsed)[:40]}'"
        raise FormatError(f"{file}:1: expected keys with values, got {got}")
    return parsed


def _parsed(file: Path, parse: Callable[[str], Any]) -> Any:
    """Parses a file. Each exception of PyYAML becomes a FormatError that names the file."""
    check_size(file, MOST_BYTES)
    try:
        return parse("\n".join(lines_of(file)))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise FormatError(f"{file}:{line}: cannot be read as YAML: {error.problem}") from None
    except FormatError:
        raise
    except (yaml.YAMLError, *NO_VALUE) as error:  # raised, for example, for the date 2025-13-45
        raise FormatError(
            f"{file}: cannot be read as YAML: {' '.join(str(error).split())}"
        ) from None


class YamlNode:
    """A node of a YAML file with its location. Errors name file, line and key."""

    def __init__(self, file: Path, node: yaml.Node | None, key: str) -> None:
        self.file, self.node, self.key = file, node, key

    def at(self, key: str) -> "YamlNode":
        path = f"{self.key}.{key}" if self.key else key
        if not isinstance(self.node, yaml.MappingNode):
            self.fail(f"expected a mapping with the key '{key}', got {self._shown()}")
        nodes = [node for name, node in self.node.value if name.value == key]
        if not nodes:
            self.fail(f"expected a key '{key}', got none")
        if len(nodes) > 1:
            YamlNode(self.file, nodes[1], path).fail("expected the key once, got it twice")
        return YamlNode(self.file, nodes[0], path)

    def items(self) -> "list[YamlNode]":
        if not isinstance(self.node, yaml.SequenceNode) or not self.node.value:
            self.fail(f"expected a list with one or more entries, got {self._shown()}")
        return [YamlNode(self.file, n, f"{self.key}[{i}]") for i, n in enumerate(self.node.value)]

    def maybe(self, key: str) -> "YamlNode | None":
        """Returns the node of a key, or None if the key is absent."""
        node = self.node
        names = [name.value for name, _ in node.value] if isinstance(node, yaml.MappingNode) else []
        return self.at(key) if key in names else None

    def entries(self, key: str) -> "list[YamlNode]":
        """Returns the entries of the list under a key; an empty list if the key is absent."""
        node = self.maybe(key)
        return node.items() if node and node.node and node.node.value else []

    def values(self, key: str) -> "list[YamlNode]":
        """Returns the values of the mapping under a key, in file order.

        The list is empty if the key is absent.
        """
        mapping = self.maybe(key)
        if mapping is None:
            return []
        if not isinstance(mapping.node, yaml.MappingNode):
            mapping.fail(f"expected a mapping, got {mapping._shown()}")
        return [
            YamlNode(self.file, node, f"{mapping.key}.{k.value}") for k, node in mapping.node.value
        ]

    def text(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            self.fail(f"expected one value, got {self._shown()}")
        return str(self.node.value)

    def number(
        self, low: float = -math.inf, high: float = math.inf, *, or_nan: bool = False
    ) -> float:
        """Returns a finite number from low to high. `or_nan` also allows .nan (unknown)."""
        text = self.text()
        try:
            value = float(text.replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError:
            self.fail(f"expected a number, got '{text}'")
        if or_nan and math.isnan(value):
            return value
        if not (math.isfinite(value) and low <= value <= high):
            self.fail(f"expected {low:g} to {high:g}, got {text}")
        return value

    def whole(self, high: int) -> int:
        """Returns a whole number from 0 to high."""
        text = self.text()
        if not re.fullmatch(r"[0-9]{1,20}", text) or int(text) > high:
            self.fail(f"expected a whole number from 0 to {high}, got '{text[:40]}'")
        return int(text)

    def interval(self, low: float, high: float) -> tuple[float, float]:
        values = [item.number(low, high) for item in self.items()]
        if len(values) != 2 or values[0] > values[1]:
            self.fail(f"expected two numbers in ascending order, got {values}")
        return values[0], values[1]

    def _shown(self) -> str:
        if isinstance(self.node, yaml.ScalarNode):
            return f"'{self.node.value[:40]}'"
        if self.node is None:
            return "an empty file"
        kind = "a list" if isinstance(self.node, yaml.SequenceNode) else "a mapping"
        return kind if self.node.value else f"{kind} without entries"

    def fail(self, what: str) -> NoReturn:
        raise FormatError(f"{self.location()}: {what}")

    def location(self) -> str:
        """Returns `file:line: key`; the root has no key."""
        line = self.node.start_mark.line + 1 if self.node is not None else 1
        return f"{self.file}:{line}" + (f": {self.key}" if self.key else "")
