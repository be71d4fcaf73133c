"""Writes docs/reference.md, which lists every configuration key.

Scene and LiDAR keys come from `infrasim keys`. Detector and benchmark keys are the fields of
dataclasses, and their descriptions are the fields' comments. `make reference` runs this script. A
test compares the page with the script's output.
"""

import ast
import dataclasses
import inspect
import math
import subprocess
import textwrap
import types
import typing
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from pyinfra.core.config import Rule, as_plain
from pyinfra.core.vocabulary import TIERS
from pyinfra.dataset.launch import binary
from pyinfra.experiments.benchmark.matrix import Benchmark
from pyinfra.models.detectors.catalogue import DETECTORS
from pyinfra.models.training.recipe import Learning
from pyinfra.models.training.samples import Augmentation

PAGE = Path(__file__).resolve().parents[1] / "docs/reference.md"
UNITS = {  # unit by the suffix of a key; the first matching suffix counts
    "_mm_per_h": "mm/h",
    "_km_h": "km/h",
    "usd_per_kwh": "USD/kWh",
    "_per_km_lane": "per km and lane",
    "_per_s": "per s",
    "_per_m": "per m",
    "_percent_m": "m",
    "_usd": "USD",
    "_deg": "degrees",
    "_hz": "per s",
    "_klux": "klx",
    "_us": "µs",
    "rpm": "per min",
    "years": "years",
    "_m": "m",
    "_s": "s",
    "_w": "W",
}
WORDS = {float: "number", int: "whole number", bool: "true or false", str: "text"}


@dataclass(frozen=True)
class Key:
    """A configuration key, which is one row of a table."""

    path: str
    kind: str
    default: str
    allowed: str
    meaning: str

    @property
    def unit(self) -> str:
        name = self.path.rsplit(".", 1)[-1]
        number = any(word in self.kind for word in ("number", "pair"))
        return next((u for end, u in UNITS.items() if number and name.endswith(end)), "")


def simulator_keys(kind: str) -> list[Key]:
    """Returns the keys of `scene` or `lidar` files. Raises CalledProcessError."""
    words = [str(binary()), "keys", kind]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return [Key(*line.split("\t")) for line in text.splitlines()]


def dataclass_keys(kind: type[Any], path: str = "", values: object = None) -> Iterator[Key]:
    """Yields the keys of a dataclass.

    Parameters
    ----------
    path : prefix of the keys
    values : object whose attributes replace the defaults of the class
    """
    hints, meanings = typing.get_type_hints(kind), comments(kind)
    for field in dataclasses.fields(kind):
        default = default_of(field) if values is None else getattr(values, field.name)
        rule = field.metadata.get("rule", Rule())
        key_path, hint = path + field.name, hints[field.name]
        inner = next((a for a in (hint, *typing.get_args(hint)) if is_struct(a)), None)
        meaning = meanings.get(field.name) or (first_line(inner) if inner else "")
        yield Key(key_path, type_of(hint), shown(default, inner), allowed(hint, rule), meaning)
        if inner is not None:
            several = inner is not hint
            yield from dataclass_keys(
                inner, f"{key_path}.N." if several else f"{key_path}.", None if several else default
            )


def default_of(field: Any) -> object:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def is_struct(hint: object) -> bool:
    return isinstance(hint, type) and dataclasses.is_dataclass(hint)


def type_of(hint: Any) -> str:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if is_struct(hint):
        return "section"
    if origin is typing.Literal:
        return "word"
    if origin in (typing.Union, types.UnionType):
        return type_of(next(a for a in arguments if a is not type(None)))
    if origin is tuple:
        many = "list of" if arguments[-1] is Ellipsis else str(len(arguments))
        return f"{many} {type_of(arguments[0])}s"
    return WORDS[hint]


def shown(default: object, inner: object) -> str:
    if default is dataclasses.MISSING:
        return "required"
    if inner is not None:
        return ""
    plain = as_plain(default)
    return f'"{plain}"' if isinstance(plain, str) else str(plain)


def allowed(hint: Any, rule: Rule) -> str:
    words = [a for a in (hint, *typing.get_args(hint)) if typing.get_origin(a) is typing.Literal]
    if words:
        return ", ".join(typing.get_args(words[0]))
    ends = {"from": rule.low, "up to": rule.high}
    return " ".join(f"{w} {number(v)}" for w, v in ends.items() if math.isfinite(v))


def number(value: float) -> str:
    return f"{value:.9f}".rstrip("0").rstrip(".")


def first_line(kind: object) -> str:
    return (inspect.getdoc(kind) or "").split("\n")[0].rstrip(".").lower()


def comments(kind: type[Any]) -> dict[str, str]:
    """Returns the comment of each field of a class.

    The comment stands after the field on the same line. Without it, the first sentence of the
    comment above the field is used.
    """
    lines = textwrap.dedent(inspect.getsource(kind)).splitlines()
    (body,) = ast.parse("\n".join(lines)).body
    texts = {}
    for node in typing.cast(ast.ClassDef, body).body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            text = lines[(node.end_lineno or 0) - 1][node.end_col_offset :]
            texts[node.target.id] = text.strip(" #") or above(lines[: node.lineno - 1])
    return texts


def above(lines: list[str]) -> str:
    block: list[str] = []
    while lines and lines[-1].lstrip().startswith("#"):
        block.insert(0, lines.pop().strip(" #"))
    return " ".join(block).split(". ")[0].rstrip(".")


def table(keys: Iterable[Key]) -> str:
    rows = [("key", "type", "default", "unit", "allowed", "meaning"), ("---",) * 6]
    for key in keys:
        default = "required" if key.default == "required" else code(key.default)
        rows.append((code(key.path), key.kind, default, key.unit, key.allowed, key.meaning))
    return "".join(f"| {' | '.join(cell or ' ' for cell in row)} |\n" for row in rows)


def code(text: str) -> str:
    return f"`{text}`" if text else ""


def sections(keys: list[Key]) -> str:
    """Returns a table of the keys that belong to no section, and a table for each section."""
    groups = {k: list(g) for k, g in groupby(keys, lambda key: key.path.split(".")[0])}
    plain = [key for group in groups.values() if len(group) == 1 for key in group]
    text = table(plain) if plain else ""
    for name, group in groups.items():
        if len(group) > 1:
            text += f"\n### {name}\n{table(group)}"
    return text


def networks() -> str:
    """Returns a table for each detector's Config; detectors with the same class share a table."""
    named = {name: entry.config for name, entry in DETECTORS.items()}
    text = ""
    for config, names in groupby(named, lambda name: named[name]):
        title = ", ".join(names)
        text += f"\n### network of {title}\n{table(dataclass_keys(config, values=config()))}"
    return text


def page() -> str:
    return f"""# Configuration keys

This page lists every configuration key with its type, default, unit and allowed values. N is an
index in a list, and NAME is a name of your choice. A key without the default `required` is
optional. Unknown keys, wrong types and values out of range are errors that name file, line and key.
Paths inside a file are relative to that file. `make reference` writes the page from the code.

## Scene (`configs/scenes`, read by `infrasim run`)
`--set KEY=VALUE` overrides a key by its path, such as `--set mounts.pole.z_m=8`. The section
`presets` has sections of keys by preset, such as `datasheet`. They override the other keys if the
LiDARs of the run use this preset.

{sections(simulator_keys("scene"))}
## LiDAR (`configs/lidars`, read by `infrasim run --lidar`)
A file has either `pattern`, `returns` and `price_usd`, or a `bundle`. `pattern` has one of
`spinning`, `prisms` and `table`. The section `presets` has sections of the same keys by preset
(`paper`, `equal`, `datasheet`). They override the rest of the file if this preset is used.

{sections(simulator_keys("lidar"))}
## Detector (`configs/detectors`, read by `pyinfra train`)
`detector` is one of {", ".join(DETECTORS)}.
`tiers` has the sections {", ".join(TIERS)}. Each has the sections `network`, `learning` and
`augmentation`. Keys that are left out have their defaults.

### learning
{table(dataclass_keys(Learning, values=Learning()))}
### augmentation
{table(dataclass_keys(Augmentation, values=Augmentation()))}{networks()}
## Benchmark (`configs/benchmarks`, read by `pyinfra benchmark`)
{table(dataclass_keys(Benchmark))}"""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
