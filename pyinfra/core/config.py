"""Reads YAML configurations of the Python package into frozen dataclasses.

Each key of a file is a field of the class. The field defines the default value of the key. The
`rule` of the field defines the allowed range.
Unknown and repeated keys, wrong types and values out of range raise an error that names file, line
and key.
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
from yaml.constructor import SafeConstructor

from pyinfra.core.errors import ConfigError
from pyinfra.core.files import check_size

T = TypeVar("T")

# CSafeLoader is ten times faster than SafeLoader.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_MOST_LEVELS = 100  # maximum depth of nested values; deeper nesting crashes libyaml
_MOST_VALUES = 1_000_000  # maximum number of values in a file, with aliases expanded
MOST_BYTES = 64 << 20  # maximum size of a file, in bytes
# PyYAML raises these exceptions for some values that have no Python equivalent.
NO_VALUE = (ValueError, LookupError, AttributeError, ArithmeticError)
_MOST_LETTERS = 60  # a message shows at most this many characters of a value


# A run or result row is identified by its configuration, written with the key names of version
# 0.3. Renaming or adding a key therefore does not change the identity of older runs and rows.
# RENAMED maps current keys (`key` or `Class.key`) to their names in 0.3, which files may also use.
RENAMED: dict[str, str] = {"rois_detected": "rois_found", "Settings.replicates": "draws"}
# Keys that were added after version 0.3. While such a key has its default value, it is not part of
# the identity of a run or row.
LATER: frozenset[str] = frozenset(
    (
        "Learning.rare_windows",
        "Learning.balance",
        "Augmentation.shadows",
        "Augmentation.height_std_m",
        "Augmentation.level_std_deg",
        "Recipe.hook",
        "Recipe.loss",
    )
)


@dataclass(frozen=True)
class Rule:
    """The allowed values of a key, or of each entry of a list."""

    low: float = -math.inf
    high: float = math.inf
    # Called with the file and a text value; raises Error if the text is not allowed.
    check: Callable[[Path, str], object] | None = None
    once: bool = False  # whether a list must not contain the same value twice


def ruled(
    default: Any = dataclasses.MISSING,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    once: bool = False,
) -> Any:
    """Returns a dataclass field with a range of allowed numbers.

    The key is required if it has no default.
    """
    return field(default=default, metadata={"rule": Rule(low, high, once=once)})


def checked(
    check: Callable[[Path, str], object],
    default: Any = dataclasses.MISSING,
    *,
    once: bool = False,
) -> Any:
    """Returns a dataclass field for a text or a list of texts. Each text must pass the check.

    `Rule` describes the check. The key is required if it has no default.
    """
    return field(default=default, metadata={"rule": Rule(check=check, once=once)})


def read_config(file: Path, kind: type[T]) -> T:
    """Reads a YAML file into a dataclass `kind`. Raises ConfigError and FileNotFoundError."""
    try:
        check_size(file, MOST_BYTES)
        node = compose(file.read_text(encoding="utf-8-sig"))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{file}:{line}: cannot be read as YAML: {error.problem}") from None
    except yaml.YAMLError as error:  # the file contains a character that YAML does not allow
        raise ConfigError(
            f"{file}: cannot be read as YAML: {' '.join(str(error).split())}"
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{file}: expected UTF-8, got an invalid byte at offset {error.start}"
        ) from None
    return _struct(_Location(str(file), node, ""), kind)


def compose(text: str) -> Any:
    """Returns the root node of a YAML text, or None for an empty text. Raises yaml.YAMLError."""
    level = 0
    for event in yaml.parse(text, Loader=_LOADER):
        level += isinstance(event, yaml.CollectionStartEvent)
        level -= isinstance(event, yaml.CollectionEndEvent)
        if level > _MOST_LEVELS:
            problem = f"expected at most {_MOST_LEVELS} nested levels, got more"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)
    root = yaml.compose(text, Loader=_LOADER)
    if "*" in text and root is not None:
        _values_of(root, {})
    return root


def _values_of(node: Any, known: dict[int, int]) -> int:
    """Returns the number of values of a node with its aliases expanded.

    known: the number of values of each counted node, by `id`; 0 while a node is counted. Raises
    yaml.MarkedYAMLError for too many values, or if a node has an alias to itself.
    """
    if id(node) in known and known[id(node)] == 0:
        problem = "expected no alias to a value that contains this alias, got one"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    if id(node) not in known:
        known[id(node)] = 0
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        pairs = isinstance(node, yaml.MappingNode)
        total = 1 + sum(
            _values_of(part, known) for one in parts for part in (one if pairs else (one,))
        )
        if total > _MOST_VALUES:
            problem = f"expected at most {_MOST_VALUES} values, got more through aliases"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        known[id(node)] = total
    return known[id(node)]


def as_plain(value: Any) -> Any:
    """Converts a dataclass to dicts and lists, for `yaml.safe_dump` and `from_plain`."""
    if dataclasses.is_dataclass(value):
        return {f.name: as_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, (tuple, list)):
        return [as_plain(item) for item in value]
    return value


def canonical(value: Any) -> Any:
    """Converts like `as_plain`, but with the key names that identify runs and rows.

    These key names are those of version 0.3. Keys in LATER are left out if they have their default
    value.
    """
    if isinstance(value, (tuple, list)):
        return [canonical(item) for item in value]
    if not dataclasses.is_dataclass(value):
        return value
    kind = type(value)
    fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    default = {f.name: _default(f) for f in dataclasses.fields(value)}
    return {
        _name_in_0_3(kind, name): canonical(item)
        for name, item in fields.items()
        if not (LATER & {name, f"{kind.__name__}.{name}"} and item == default[name])
    }


def _name_in_0_3(kind: type, key: str) -> str:
    return RENAMED.get(f"{kind.__name__}.{key}", RENAMED.get(key, key))


def _default(field: "dataclasses.Field[Any]") -> Any:
    factory: Any = field.default_factory
    return field.default if factory is dataclasses.MISSING else factory()


def from_plain(plain: object, kind: type[T], name: str) -> T:
    """Inverts `as_plain`, with the checks of `read_config`. Messages show `name` as the file."""
    return _struct(_Location(name, compose(yaml.safe_dump(plain)), ""), kind)


@dataclass(frozen=True)
class _Location:
    file: str
    node: Any
    key: str

    def fail(self, what: str) -> NoReturn:
        line = self.node.start_mark.line + 1 if self.node is not None else 1
        raise ConfigError(f"{self.file}:{line}: {self.key or '(document)'}: {what}")

    def at(self, key: str, node: Any) -> "_Location":
        return _Location(self.file, node, f"{self.key}.{key}" if self.key else key)


@dataclass(frozen=True)
class Part:
    """A section of a file, which is read later, because the rest of the file sets its dataclass."""

    location: _Location | None = None  # place of the section; None if the file has no such section

    def read(self, kind: type[T]) -> T:
        """Reads the section into a dataclass. Raises ConfigError with file, line and key."""
        return kind() if self.location is None else _struct(self.location, kind)


def _struct(location: _Location, kind: type[T]) -> T:
    if not isinstance(location.node, yaml.MappingNode):
        location.fail(f"expected a mapping, got {_shown(location.node)}")
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    hints = typing.get_type_hints(kind)
    locations: dict[str, _Location] = {}
    now = {_name_in_0_3(kind, name): name for name in fields}
    for key_node, node in location.node.value:
        key = _shown(key_node).strip("'")
        key = now.get(key, key)
        here = location.at(key, node)
        if key not in fields:
            here.fail(f"expected one of the keys {', '.join(fields)}; got an unknown key")
        if key in locations:
            here.fail("expected the key once, got it twice")
        locations[key] = here
    for name, f in fields.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in locations:
            location.at(name, location.node).fail("expected a value, got none")
    rules = {name: f.metadata.get("rule", Rule()) for name, f in fields.items()}
    values = {key: _value(here, hints[key], rules[key]) for key, here in locations.items()}
    try:
        return kind(**values)
    except ValueError as error:  # raised by the class, which checks several keys together
        location.fail(str(error))


def _value(location: _Location, hint: Any, rule: Rule) -> Any:
    if hint is Any:
        return _loaded(location, "a value")
    if hint is Part:
        return Part(location)
    if dataclasses.is_dataclass(hint):
        return _struct(location, typing.cast(type[Any], hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if isinstance(location.node, yaml.ScalarNode) and location.node.tag.endswith(":null"):
            return None
        return _value(location, next(a for a in arguments if a is not type(None)), rule)
    if origin is typing.Literal:
        return _word(location, arguments)
    if origin is tuple:
        return _items(location, arguments, rule)
    return _scalar(location, hint, rule)


def _items(location: _Location, arguments: tuple[Any, ...], rule: Rule) -> tuple[Any, ...]:
    if not isinstance(location.node, yaml.SequenceNode):
        location.fail(f"expected a list, got {_shown(location.node)}")
    nodes = location.node.value
    if arguments[-1] is not Ellipsis and len(nodes) != len(arguments):
        location.fail(f"expected {len(arguments)} values, got {len(nodes)}")
    locations = [location.at(str(i), node) for i, node in enumerate(nodes)]
    values = [_value(here, arguments[0], rule) for here in locations]
    if rule.once:
        first: dict[Any, int] = {}
        for i, value in enumerate(values):
            if first.setdefault(value, i) != i:
                locations[i].fail(f"expected each value once, got {_shown(nodes[i])} twice")
    return tuple(values)


def _word(location: _Location, allowed: tuple[Any, ...]) -> Any:
    if not isinstance(location.node, yaml.ScalarNode) or location.node.value not in allowed:
        words = ", ".join(map(str, allowed))
        location.fail(f"expected one of {words}; got {_shown(location.node)}")
    return location.node.value


def _scalar(location: _Location, kind: type[Any], rule: Rule) -> Any:
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
    value: Any = _loaded(location, names[kind])
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if type(value) is not kind and not (kind is float and is_whole):
        location.fail(f"expected {names[kind]}, got {_shown(location.node)}")
    if kind in (int, float) and not rule.low <= value <= rule.high:
        text = _shown(location.node).strip("'").lstrip(".")
        location.fail(f"expected {rule.low:g} to {rule.high:g}, got {text}")
    if kind is str and rule.check is not None:
        try:
            rule.check(Path(location.file), value)
        except ValueError as error:
            location.fail(str(error))
    try:
        return float(value) if kind is float else value
    except OverflowError:
        location.fail(f"expected {names[kind]}, got {_shown(location.node)}")


def _loaded(location: _Location, allowed: str) -> Any:
    """Returns the Python value of a YAML node."""
    try:
        return SafeConstructor().construct_document(location.node)
    except (yaml.YAMLError, *NO_VALUE):  # the value is, for example, 2001-02-30 or `!!int x`
        location.fail(f"expected {allowed}, got {_shown(location.node)}")


def _shown(node: Any) -> str:
    if not isinstance(node, yaml.ScalarNode):
        return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"
    text = str(node.value)
    return f"'{text}'" if len(text) <= _MOST_LETTERS else f"'{text[:_MOST_LETTERS]}...'"
