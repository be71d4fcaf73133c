"""Writes a page whole, or not at all if it is too large."""

from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import check_output, write


def check_file(out: Path, begins: bytes = b"<!doctype html") -> None:
    """Raises Error if `out` is a folder, or a file that does not begin like a page.

    begins: first bytes of an output that is not a page.
    """
    if out.is_dir():
        raise Error(f"out: expected the name of a file, got the folder {out}")
    check_output(out, begins)


def write_page_file(text: str, out: Path, largest_mb: float, advice: str) -> int:
    """Writes a page and returns its size in bytes.

    Raises Error before writing if the page exceeds `largest_mb`; the message ends with `advice`.
    """
    page = text.encode()
    if len(page) > 1e6 * largest_mb:
        raise Error(
            f"{out}: expected up to {largest_mb:g} MB, got {len(page) / 1e6:.1f} MB; {advice}"
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    write(out, page)
    return len(page)
