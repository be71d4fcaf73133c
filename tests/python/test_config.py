"""Configurations in Python: one class defines the allowed content of a file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from message_pattern import pattern

from pyinfra.core.config import as_plain, from_plain, read_config, ruled
from pyinfra.core.errors import ConfigError


@dataclass(frozen=True)
class Inner:
    width: int = ruled(3, 1, 10)
    sizes: tuple[float, ...] = ruled((1.0,), 0, 5)


@dataclass(frozen=True)
class Outer:
    name: str
    kind: Literal["a", "b"] = "a"
    pair: tuple[float, float] = (0.0, 1.0)
    inner: Inner = Inner()
    more: Inner | None = None
    on: bool = False

    def __post_init__(self) -> None:
        if self.pair[0] > self.pair[1]:
            raise ValueError("pair: expected rising, got it falling")


def written(folder: Path, text: str) -> Path:
    file = folder / "c.yaml"
    file.write_text(text)
    return file


def test_a_file_fills_the_class_and_keeps_its_defaults(tmp_path: Path) -> None:
    text = "name: x\nkind: b\ninner: {sizes: [1, 2.5]}\nmore: {width: 4}\n"
    parsed = read_config(written(tmp_path, text), Outer)
    assert parsed == Outer("x", "b", inner=Inner(sizes=(1.0, 2.5)), more=Inner(4))
    assert from_plain(as_plain(parsed), Outer, "plain") == parsed


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + "name: Straße\nkind: b\n".encode())
    assert read_config(file, Outer).name == "Straße"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: (document): expected ..., got "),
        (
            "name: x\nwidth: 3\n",
            ":2: width: expected one of the keys name, kind, ...; got an unknown key",
        ),
        ("name: x\nname: y\n", ":2: name: expected the key once, got it twice"),
        ("kind: a\n", ":1: name: expected a value, got none"),
        ("name: 3\n", ":1: name: expected a text, got '3'"),
        ("name: x\nkind: c\n", ":2: kind: expected one of a, b; got 'c'"),
        ("name: x\npair: [1]\n", ":2: pair: expected 2 values, got 1"),
        ("name: x\npair: [2, 1]\n", ":1: (document): pair: expected rising, got it falling"),
        ("name: x\ninner:\n  width: 11\n", ":3: inner.width: expected 1 to 10, got 11"),
        ("name: x\ninner:\n  width: 1.5\n", ":3: inner.width: expected a whole number, got '1.5'"),
        ("name: x\ninner:\n  sizes: [.nan]\n", ":3: inner.sizes.0: expected 0 to 5, got nan"),
        ("name: x\non: 1\n", ":2: on: expected true or false, got '1'"),
        ("name: [x\n", "cannot be read as YAML"),
        ("name: x\0\n", "cannot be read as YAML"),
        ("[" * 200_000, "cannot be read as YAML: expected at most 100 nested levels, got more"),
        ("- " * 200_000, "cannot be read as YAML: expected at most 100 nested levels, got more"),
        (f"name: x\npair: [0, {'9' * 400}]\n", ":2: pair.1: expected ..., got '9999"),
        (f"name: x\npair: [0, {'9' * 5000}]\n", ":2: pair.1: expected ..., got '9999"),
        ("name: !!int x\n", ":1: name: expected a text, got 'x'"),
        ("name: !!int\n", ":1: name: expected a text, got ''"),
        ("name: !!bool x\n", ":1: name: expected a text, got 'x'"),
        ("name: !!timestamp x\n", ":1: name: expected a text, got 'x'"),
        ("name: 2001-02-30\n", ":1: name: expected a text, got '2001-02-30'"),
        ("name: !new:os.system x\n", ":1: name: expected a text, got 'x'"),
        ("name: x\n[a, b]: 3\n", "got an unknown key"),
    ],
)
def test_a_wrong_file_is_named_by_line_and_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=pattern(message)):
        read_config(written(tmp_path, text), Outer)
