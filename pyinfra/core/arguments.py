"""Checks arguments of public functions against the annotations of their signatures.

An annotation such as `int | None`, `Sequence[int]` or `Tier` says which values are accepted, and a
table of ranges says how large numbers may be. If this module does not know an annotation, it
accepts every value; the function then checks the value itself.
"""

from __future__ import annotations

import ast
import inspect
import math
import numbers
import operator
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING
from functools import cache
from typing import Any, Literal, get_args, get_origin

import numpy as np

from pyinfra.core import vocabulary
from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion

Range = tuple[float, float]
_signature = cache(inspect.signature)


class ArgumentError(Error, TypeError):
    """An argument of a wrong type, or with an unknown name."""


class _NoMatch(Exception):
    """A value does not match one alternative of an annotation."""


def checked_call(
    function: Callable[..., Any],
    args: tuple[Any, ...],
    named: Mapping[str, Any],
    ranges: Mapping[str, Range],
) -> dict[str, Any]:
    """Returns the arguments of a call by name, with NumPy numbers as Python numbers.

    Raises ArgumentError for an unknown name, a missing argument and a wrong type, and Error for a
    number out of range or an unknown word.
    """
    signature, name, kinds = _signature(function), function.__name__, function.__annotations__
    for word in named:
        if word not in signature.parameters:
            near = _field_of(word, function) or suggestion(word, signature.parameters)
            raise ArgumentError(f"{name}: expected arguments of this function, got '{word}'{near}")
    try:
        given = signature.bind(*args, **named).arguments
    except TypeError as error:
        raise ArgumentError(f"{name}: {error}") from None
    scope = vars(vocabulary) | getattr(function, "__globals__", {})
    return {
        key: checked(value, str(kinds[key]), scope, key, ranges.get(key)) if key in kinds else value
        for key, value in given.items()
    }


def _field_of(word: str, function: Callable[..., Any]) -> str:
    """Returns a hint if a word, or its plural, is a field of a function's settings; else "".

    Settings are records that can be made without arguments.
    """
    for key, annotation in function.__annotations__.items():
        record = str(annotation).partition(" ")[0]
        fields = getattr(function.__globals__.get(record), "__dataclass_fields__", {})
        if any(f.default is f.default_factory is MISSING for f in fields.values()):
            continue
        for name in {word, f"{word}s"} & set(fields):
            return f"; write {key}={record}({name}=...)"
    return ""


def check_fields(record: object, ranges: Mapping[str, Range]) -> None:
    """Checks the fields of a frozen dataclass, and converts NumPy numbers.

    Raises the errors of `checked_call`.
    """
    scope = vars(inspect.getmodule(type(record)))
    for key, annotation in type(record).__annotations__.items():
        value = checked(getattr(record, key), str(annotation), scope, key, ranges.get(key))
        object.__setattr__(record, key, value)


def checked(
    value: Any, annotation: str, scope: Mapping[str, Any], name: str, limits: Range | None = None
) -> Any:
    """Returns a value that fits an annotation. Raises ArgumentError and Error.

    scope: names that the annotation may use. limits: smallest and largest allowed number, also for
    each number in a list.
    """
    node = ast.parse(annotation, mode="eval").body
    expected = []
    for alternative in _alternatives(node, scope):
        try:
            result = _convert(value, alternative, scope)
        except _NoMatch as error:
            expected.append(str(error))
            continue
        if limits is not None:
            _check_range(result, limits, name)
        return result
    wanted = " or ".join(dict.fromkeys(expected))
    words = [
        word
        for part in _alternatives(node, scope)
        for kind in (part, *_items(part))
        for word in _choices(kind, scope)
    ]
    items = value if isinstance(value, (list, tuple)) else [value]
    unknown = [item for item in items if isinstance(item, str) and item not in words]
    near = suggestion(unknown[0], words) if unknown and words else ""
    shown = f"'{value}'" if isinstance(value, str) else f"{_short(value)} ({type(value).__name__})"
    raise (Error if near else ArgumentError)(f"{name}: expected {wanted}, got {shown}{near}")


def _check_range(value: Any, limits: Range, name: str) -> None:
    least, most = limits
    for number in value if isinstance(value, (list, tuple)) else [value]:
        if isinstance(number, (int, float)) and not least <= number <= most:
            low, high, got = (f"{x}" if isinstance(x, int) else f"{x:g}" for x in (*limits, number))
            upper = f"{low} to {high}" if most < math.inf else f"{low} or more"
            raise Error(f"{name}: expected {upper}, got {got}")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _alternatives(node: ast.expr, scope: Mapping[str, Any]) -> list[ast.expr]:
    """Returns the parts of a union; an alias of a union in `scope` is expanded."""
    if isinstance(node, ast.BinOp):
        return [*_alternatives(node.left, scope), *_alternatives(node.right, scope)]
    alias = scope.get(node.id) if isinstance(node, ast.Name) else None
    if node_of_alias := _source(alias):
        return _alternatives(node_of_alias, scope)
    return [node]


def _source(alias: object) -> ast.expr | None:
    """Returns the expression of a type alias: a text, or a union such as `str | PathLike[str]`."""
    text = alias if isinstance(alias, str) else ""
    if type(alias).__name__ == "UnionType":
        text = " | ".join(getattr(part, "__name__", str(part)) for part in get_args(alias))
    return ast.parse(text, mode="eval").body if text else None


def _choices(node: ast.expr, scope: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the words of a Literal or of an alias of one."""
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Literal":
        words = ast.literal_eval(node.slice)
        return words if isinstance(words, tuple) else (words,)
    alias = scope.get(node.id) if isinstance(node, ast.Name) else None
    return get_args(alias) if get_origin(alias) is Literal else ()


def _convert(value: Any, node: ast.expr, scope: Mapping[str, Any]) -> Any:
    """Returns the value for one alternative of an annotation. Raises _NoMatch."""
    if words := _choices(node, scope):
        return _must(isinstance(value, str) and value in words, f"one of {', '.join(words)}", value)
    name = ast.unparse(node.value if isinstance(node, ast.Subscript) else node).split(".")[-1]
    if name in _SIMPLE:
        return _SIMPLE[name](value)
    if name in ("Sequence", "Iterable", "list", "tuple") and isinstance(node, ast.Subscript):
        return _converted_list(value, node, name, scope)
    kind = scope.get(name)
    if (
        isinstance(kind, type)
        and kind.__module__.startswith("pyinfra")
        and not getattr(kind, "_is_protocol", False)
    ):
        return _must(isinstance(value, kind), f"{'an' if name[0] in 'AEIO' else 'a'} {name}", value)
    return value


def _converted_list(value: Any, node: ast.Subscript, name: str, scope: Mapping[str, Any]) -> Any:
    parts = _items(node)
    is_list = isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping))
    text = f"{len(parts)} values" if len(parts) > 1 else f"a list of {_plural(parts[0], scope)}"
    if not is_list or (hasattr(value, "ndim") and value.ndim == 0):
        raise _NoMatch(text)
    if isinstance(value, range):
        return value
    values = list(value)
    if len(parts) > 1:
        _must(len(values) == len(parts), text, value)
    kinds = parts if len(parts) > 1 else parts * len(values)
    try:
        items = []
        for item, kind in zip(values, kinds, strict=True):
            items.append(_first(item, _alternatives(kind, scope), scope))
    except _NoMatch as error:
        raise _NoMatch(f"{text}" if len(parts) == 1 else f"{text}, each {error}") from None
    return tuple(items) if name == "tuple" else items


def _items(node: ast.expr) -> list[ast.expr]:
    """Returns the annotations of the items of a list or tuple."""
    inner = node.slice if isinstance(node, ast.Subscript) else None
    parts = inner.elts if isinstance(inner, ast.Tuple) else [inner] if inner else []
    return [part for part in parts if ast.unparse(part) != "..."]


def _first(value: Any, alternatives: list[ast.expr], scope: Mapping[str, Any]) -> Any:
    for i, alternative in enumerate(alternatives):
        try:
            return _convert(value, alternative, scope)
        except _NoMatch:
            if i == len(alternatives) - 1:
                raise
    return value


def _plural(node: ast.expr, scope: Mapping[str, Any]) -> str:
    names = {"int": "whole numbers", "float": "numbers", "str": "names", "StrPath": "paths"}
    words, text = _choices(node, scope), ast.unparse(node)
    other = text if isinstance(node, ast.Name) else "values"
    return f"words among {', '.join(words)}" if words else names.get(text, other)


def _must(holds: bool, text: str, value: Any) -> Any:
    if not holds:
        raise _NoMatch(text)
    return value


def _whole(value: Any) -> int:
    try:
        return operator.index(
            _must(not isinstance(value, (bool, np.bool_)), "a whole number", value)
        )
    except TypeError:
        raise _NoMatch("a whole number") from None


def _number(value: Any) -> int | float:
    is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not is_number:  # NaN is a number here; the called function checks it
        raise _NoMatch("a number")
    return int(value) if isinstance(value, numbers.Integral) else float(value)


_SIMPLE: dict[str, Callable[[Any], Any]] = {
    "int": _whole,
    "float": _number,
    "bool": lambda v: bool(_must(isinstance(v, (bool, np.bool_)), "True or False", v)),
    "str": lambda v: _must(isinstance(v, str), "a text", v),
    "None": lambda v: _must(v is None, "None", v),
    "PathLike": lambda v: _must(isinstance(v, os.PathLike), "a path", v),
    "StrPath": lambda v: _must(isinstance(v, (str, os.PathLike)), "a name or a path", v),
    "Mapping": lambda v: _must(isinstance(v, Mapping), "a dict", v),
    "Callable": lambda v: _must(callable(v), "a function", v),
    "Progress": lambda v: _must(callable(v), "a function", v),
}
