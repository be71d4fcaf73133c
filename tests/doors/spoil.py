"""Ways to spoil a text or a row of bytes. Needs nothing but Python: a checkout's worker runs it."""

from __future__ import annotations

import random
import re

# What no value of a file may be: accepted, it must change nothing.
POISON = ("nan", ".nan", "inf", ".inf", "-.inf", "1e300", "-1e300", "1e999", "abc", "''", "\\x00")
ODD = ("0", "-1", "1e-300", "1e9", "99999999999999999999", "[]", "{}", "null", "true", "5", "0.5")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")


def text(source: str, draw: random.Random) -> tuple[str, str, bool]:
    """The text with one thing wrong, what was done, and whether a number became poison."""
    lines = source.splitlines(keepends=True) or [""]
    k = draw.randrange(len(lines))
    kind = draw.choice(
        ("poison", "poison", "odd", "odd", "drop", "twice", "indent", "key", "cut", "byte")
    )
    if kind in ("poison", "odd"):
        numbers = list(NUMBER.finditer(source))
        if numbers:
            at = draw.choice(numbers)
            value = draw.choice(POISON if kind == "poison" else ODD)
            said = f"line {source.count(chr(10), 0, at.start()) + 1}: {at[0]} -> {value}"
            value = value.replace("\\x00", "\0")
            return source[: at.start()] + value + source[at.end() :], said, kind == "poison"
        kind = "cut"
    if kind == "drop":
        del lines[k]
    elif kind == "twice":
        lines.insert(k, lines[k])
    elif kind == "indent":
        lines[k] = " " * draw.randint(1, 3) + lines[k]
    elif kind == "key":
        lines[k] = re.sub(r"\w+", lambda m: m[0] + "x", lines[k], count=1)
    else:
        raw = source.encode()
        if not raw:
            return "x", "x in an empty file", False
        at = draw.randrange(len(raw))
        if kind == "cut":
            return raw[:at].decode(errors="replace"), f"cut at byte {at}", False
        flipped = raw[:at] + bytes([raw[at] ^ (1 << draw.randrange(8))]) + raw[at + 1 :]
        return flipped.decode(errors="surrogateescape"), f"bit of byte {at}", False
    return "".join(lines), f"line {k + 1}: {kind}", False


def binary(source: bytes, draw: random.Random) -> tuple[bytes, str]:
    """Bytes cut, grown, or with four of them replaced by a float that is none or huge."""
    kind = draw.choice(("cut", "grow", "float"))
    at = draw.randrange(max(1, len(source)))
    if kind == "cut":
        return source[:at], f"cut at byte {at}"
    if kind == "grow":
        return source + bytes(draw.randrange(1, 16)), "grown"
    at -= at % 4
    value = draw.choice((b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\x7f\x7f"))
    return source[:at] + value + source[at + 4 :], f"float at byte {at}: {value.hex()}"
