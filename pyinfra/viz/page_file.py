"""Writes an HTML page, unless it is too large or would replace another kind of file."""

from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import check_output, write


def check_file(out: Path, begins: bytes = b"<!doctype html") -> None:
    """Raises Error if `out` is a folder, or a file that is not an earlier output.

    begins: first bytes of an earlier output; by default those of a page.
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
