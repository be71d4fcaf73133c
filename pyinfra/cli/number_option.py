"""Options whose value is an amount of money, or a list of numbers such as `--centre X,Y`."""

import argparse
import re
from collections.abc import Callable


def numbers(names: str) -> Callable[[str], tuple[float, ...]]:
    """Returns a function that parses numbers with commas between them, one for each of `names`.

    names: names of the numbers for messages, such as `X,Y`. The text must have one number for each
    name.
    """

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in text.split(","))
        except ValueError:
            values = ()
        if len(values) != len(names.split(",")) or not all(abs(v) < 1e9 for v in values):
            raise argparse.ArgumentTypeError(f"expected numbers {names}, got '{text[:60]}'")
        return values

    return read


def usd(text: str) -> float:
    """Parses an amount in US dollars, such as `9000`, `9,000`, `9k` or `1.5k`.

    Raises ArgumentTypeError for `9.000`, because it means 9 in some countries and 9000 in others.
    """
    match = re.fullmatch(r"\$?(\d+|\d{1,3}(?:,\d{3})+)(\.\d+)?(k?)", text.strip(), re.IGNORECASE)
    if match is None:
        try:
            return float(text)
        except ValueError:
            message = f"expected US dollars, such as 9000, 9,000 or 9k, got '{text[:60]}'"
            raise argparse.ArgumentTypeError(message) from None
    dollars, fraction, thousands = match.groups(default="")
    if re.fullmatch(r"\.\d{3}", fraction) and not thousands:
        message = f"expected US dollars, got '{text}'; write {dollars}{fraction[1:]} or {dollars}"
        raise argparse.ArgumentTypeError(message)
    return float(dollars.replace(",", "") + fraction) * (1000 if thousands else 1)


def one_frame(text: str) -> int:
    """Parses the number of a single frame. For a range, the message names the option for ranges."""
    if not text.isdecimal():
        ranged = re.fullmatch(r"\d+:\d+(:\d+)?", text)
        more = f"; for a range of frames, use `pyinfra view --frames {text}`" if ranged else ""
        message = f"expected the number of one frame, got '{text[:60]}'{more}"
        raise argparse.ArgumentTypeError(message)
    return int(text)
