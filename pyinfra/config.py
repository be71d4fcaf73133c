"""Configurations that only Python reads: YAML files as frozen dataclasses.

A key is a field of the class, its default the field's, its range the field's `rule`. Unknown and
repeated keys, wrong types and values out of range are errors that name file, line and key.
"""

import dataclasses
import math
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import yaml

T = TypeVar("T")


class ConfigError(ValueError):
    """A wrong configuration: `file:line: key: found, allowed`."""


@dataclass(frozen=True)
class Rule:
    """What a value, or each value of a list, may be."""

    low: float = -math.inf
    high: float = math.inf
    check: Callable[[Path, str], object] | None = None  # of the file and a text; raises ValueError


def ruled(
    default: Any = dataclasses.MISSING, low: float = -math.inf, high: float = math.inf
) -> Any:
    """A field with a range; required if it has no default."""
    return field(default=default, metadata={"rule": Rule(low, high)})


def checked(check: Callable[[Path, str], object]) -> Any:
    """A required field whose texts must pass a check; see Rule."""
    return field(metadata={"rule": Rule(check=check)})


def read_config(file: Path, kind: type[T]) -> T:
    """The file as a `kind`. Raises ConfigError, and FileNotFoundError."""
    try:
        node = yaml.compose(file.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{file}:{line}: is not YAML: {error.problem}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: found byte {error.start} that is not UTF-8") from None
    return _struct(_Place(str(file), node, ""), kind)


def as_plain(value: Any) -> Any:
    """A dataclass as dicts and lists, which `yaml.safe_dump` writes and `from_plain` reads."""
    if dataclasses.is_dataclass(value):
        return {f.name: as_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, (tuple, list)):
        return [as_plain(item) for item in value]
    return value


def from_plain(plain: object, kind: type[T], name: str) -> T:
    """The inverse of as_plain, checked as a file is; `name` stands for the file in messages."""
    node = yaml.compose(yaml.safe_dump(plain), Loader=yaml.SafeLoader)
    return _struct(_Place(name, node, ""), kind)


@dataclass(frozen=True)
class _Place:
    file: str
    node: Any
    key: str

    def fail(self, what: str) -> NoReturn:
        line = self.node.start_mark.line + 1 if self.node is not None else 1
        raise ConfigError(f"{self.file}:{line}: {self.key or '(document)'}: {what}")

    def at(self, key: str, node: Any) -> "_Place":
        return _Place(self.file, node, f"{self.key}.{key}" if self.key else key)


@dataclass(frozen=True)
class Part:
    """A part of a file whose class is known once the rest is read."""

    place: _Place | None = None  # None: it is left out

    def read(self, kind: type[T]) -> T:
        """Raises ConfigError with file, line and key."""
        return kind() if self.place is None else _struct(self.place, kind)


def _struct(place: _Place, kind: type[T]) -> T:
    if not isinstance(place.node, yaml.MappingNode):
        place.fail("found no mapping, allowed a mapping")
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = typing.get_type_hints(kind)
    places: dict[str, _Place] = {}
    for key_node, node in place.node.value:
        key = str(key_node.value)
        here = place.at(key, node)
        if key not in fields:
            here.fail(f"found an unknown key, allowed {', '.join(fields)}")
        if key in places:
            here.fail("found twice, allowed once")
        places[key] = here
    for name, f in fields.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in places:
            place.at(name, place.node).fail("found nothing, required")
    rules = {name: f.metadata.get("rule", Rule()) for name, f in fields.items()}
    values = {key: _value(here, hints[key], rules[key]) for key, here in places.items()}
    try:
        return kind(**values)
    except ValueError as error:  # a check between keys
        place.fail(str(error))


def _value(place: _Place, hint: Any, rule: Rule) -> Any:
    if hint is Any:
        return yaml.safe_load(yaml.serialize(place.node))
    if hint is Part:
        return Part(place)
    if dataclasses.is_dataclass(hint):
        return _struct(place, typing.cast(type[Any], hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if isinstance(place.node, yaml.ScalarNode) and place.node.tag.endswith(":null"):
            return None
        return _value(place, next(a for a in arguments if a is not type(None)), rule)
    if origin is typing.Literal:
        return _word(place, arguments)
    if origin is tuple:
        return _items(place, arguments, rule)
    return _scalar(place, hint, rule)


def _items(place: _Place, arguments: tuple[Any, ...], rule: Rule) -> tuple[Any, ...]:
    if not isinstance(place.node, yaml.SequenceNode):
        place.fail("found no list, allowed a list")
    nodes = place.node.value
    if arguments[-1] is not Ellipsis and len(nodes) != len(arguments):
        place.fail(f"found {len(nodes)} values, allowed {len(arguments)}")
    return tuple(_value(place.at(str(i), n), arguments[0], rule) for i, n in enumerate(nodes))


def _word(place: _Place, allowed: tuple[Any, ...]) -> Any:
    if not isinstance(place.node, yaml.ScalarNode) or place.node.value not in allowed:
        place.fail(f"found {_shown(place.node)}, allowed {', '.join(map(str, allowed))}")
    return place.node.value


def _scalar(place: _Place, kind: type[Any], rule: Rule) -> Any:
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
    value: Any = yaml.safe_load(yaml.serialize(place.node))
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind:
        place.fail(f"found {_shown(place.node)}, allowed {names[kind]}")
    if kind in (int, float) and not rule.low <= value <= rule.high:
        place.fail(f"found {value:g}, allowed {rule.low:g} to {rule.high:g}")
    if kind is str and rule.check is not None:
        try:
            rule.check(Path(place.file), value)
        except ValueError as error:
            place.fail(str(error))
    return value


def _shown(node: Any) -> str:
    return f"'{node.value}'" if isinstance(node, yaml.ScalarNode) else "a collection"
