"""Lists the files and folders in a recording, and beside it, that the import does not read."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path

from pyinfra.core.files import resolved

MOST_LISTED = 12
MOST_ENTRIES = 100_000  # maximum number of entries of a folder that is searched
# Names of files that have no data: descriptions of a recording, and programs.
TEXTS = re.compile(r"(readme|licen[cs]e|changelog)|.*\.(py|ipynb|sh)$", re.IGNORECASE)
# Names of files and folders beside a folder of clouds that are probably labels.
LIKE_LABELS = re.compile(r"label|annot|ground.?truth|\bgts?\b|boxes|cuboid|tracks", re.IGNORECASE)


def unread_files(source: Path, reads: Sequence[Path]) -> list[str]:
    """Returns the files and folders of a recording that are not read, such as `camera/ (9 .jpg)`.

    `reads` are the files and folders that are read. Files and folders beside the recording are
    listed if their names suggest labels. Files with a name that begins with . or
    _ are not listed, and neither are texts such as a readme, or programs.
    """
    known = {resolved(path) for path in reads}
    if not known or resolved(source) in known:
        return []
    above = {parent for path in known for parent in path.parents}
    top = resolved(source)
    out = list(_unread(top, "", known, above)) if top.is_dir() else []
    for path in sorted(top.parent.iterdir()):
        if path == top or TEXTS.match(path.name) or _is_read(path, known, above):
            continue
        if LIKE_LABELS.search(path.name):
            out.append(f"../{_text(path)}")
    return out


def has_labels(unread: Iterable[str]) -> bool:
    """Returns whether one of the unread files or folders probably has labels."""
    return any(LIKE_LABELS.search(text.partition(" (")[0]) for text in unread)


def _unread(folder: Path, prefix: str, known: set[Path], above: set[Path]) -> Iterable[str]:
    files: dict[str, list[str]] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith((".", "_")) or path in known or TEXTS.match(path.name):
            continue
        if path.is_dir() and path in above:
            yield from _unread(path, f"{prefix}{path.name}/", known, above)
        elif path.is_dir():
            yield prefix + _text(path)
        else:
            files.setdefault(path.suffix, []).append(path.name)
    for suffix, names in files.items():
        yield prefix + (names[0] if len(names) == 1 else f"*{suffix} ({len(names)} files)")


def _is_read(path: Path, known: set[Path], above: set[Path]) -> bool:
    return path in above or path in known or not known.isdisjoint(path.parents)


def _text(path: Path) -> str:
    """Returns the name of a file, or of a folder with the number of its files by ending."""
    if not path.is_dir():
        return path.name
    files = (file for file in islice(path.rglob("*"), MOST_ENTRIES) if file.is_file())
    counts = Counter(file.suffix or file.name for file in files)
    kinds = ", ".join(f"{count} {suffix}" for suffix, count in counts.most_common(3))
    return f"{path.name}/ ({kinds or 'empty'})"


def listed(texts: Sequence[str]) -> str:
    """Returns the texts in one line, with the number of texts that are left out."""
    more = len(texts) - MOST_LISTED
    return "; ".join(texts[:MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")
