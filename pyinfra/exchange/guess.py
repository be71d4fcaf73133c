"""Guesses the format of a recording from the names of its folders and files."""

from collections.abc import Iterator
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import resolved
from pyinfra.exchange.dair import SIDES
from pyinfra.exchange.file_kinds import found_text, kind_of
from pyinfra.exchange.formats import IMPORTS
from pyinfra.exchange.label_files import CLOUD_FOLDERS, label_folder
from pyinfra.exchange.rcooper import is_sequence
from pyinfra.exchange.tumtraf import CLOUDS, LABELS

# Formats whose recordings can be single files, and the endings of these files in a folder.
FILES = {
    "bag": (".bag", ".mcap", ".db3"),
    "pcap": (".pcap",),
    "las": (".las", ".laz"),
    "ply": (".ply",),
    "csv": (".csv", ".xyz", ".asc", ".pts"),
    "pcd": (),
}
CLOUDS_OF_TOOLS = {name: FILES[name] for name in ("las", "ply", "csv")}
# Formats of folders, and patterns of the files that identify them. Messages show the first pattern.
PATTERNS: tuple[tuple[str, ...], ...] = (
    ("nuscenes", "sample.json", "*/sample.json"),
    ("kitti", "training/velodyne/*.bin", "training/velodyne/*/*.bin"),
    ("kitti", "velodyne/*.bin", "velodyne/*/*.bin"),
    *(("dair-v2x", f"{side}/velodyne/*.pcd".removeprefix("./")) for side in SIDES),
    ("openpcdet", "points/*.npy"),
    ("openpcdet", "points/*.bin"),
    ("rcooper", "lidar/*.pcd"),
    *(("tumtraf", f"{folder}/*.pcd", f"{folder}/*/*.pcd") for folder in CLOUDS),
    ("pcd", "*.pcd"),
    ("pcd", "points/*.pcd"),
    ("bin", "*.bin"),
)
MOST_LISTED = 8  # maximum number of folders in a message


def guess_format(source: Path) -> tuple[str, str]:
    """Returns the name of the format of a file or folder, and what shows this format.

    Raises Error like `_of_file` and `_of_folder`.
    """
    return _of_folder(source) if source.is_dir() else _of_file(source)


def _of_file(source: Path) -> tuple[str, str]:
    """Raises Error for a file that holds no recording; the message names what the file is."""
    kind = kind_of(source)
    if kind is None or not kind.format:
        got = f"{kind.name}: {kind.advice}" if kind else f"a file of unknown format, {source.name}"
        raise Error(
            f"{source}: expected a folder, or a file of the formats {', '.join(FILES)}; got {got}"
        )
    return kind.format, f"{kind.name} in {source.name}"


def _of_folder(source: Path) -> tuple[str, str]:
    """Returns the name of the format of a folder, and the files that show this format.

    Raises Error for a folder of no known format, and for a folder that several formats fit. The
    message lists the formats. If only subfolders fit a format, it lists these subfolders.
    """
    candidates = dict(formats_of(source))
    if len(candidates) == 1:
        ((name, reason),) = candidates.items()
        return name, reason
    if candidates:
        fits = ", ".join(f"{name} ({reason})" for name, reason in candidates.items())
        raise Error(f"{source}: expected one format, got {fits}; `format` selects a format")
    inside = [path for path in sorted(source.glob("*/")) if dict(formats_of(path))]
    if inside:
        names = ", ".join(str(path) for path in inside[:MOST_LISTED])
        raise Error(f"{source}: expected one recording, got a folder of recordings: {names}")
    raise Error(
        f"{source}: expected the files of one of the formats {', '.join(IMPORTS)}; got "
        f"{found_text(source)}. `format` sets the format"
    )


def formats_of(source: Path) -> Iterator[tuple[str, str]]:
    """Yields each format that a folder may have, and the files that show this format."""
    labels = label_folder(source)
    for name, *patterns in PATTERNS:
        fits = any(any(source.glob(pattern)) for pattern in patterns)
        if not fits or (name == "rcooper" and labels):
            continue
        yield "pcd" if name == "rcooper" and not is_sequence(source) else name, patterns[0]
        if name == "pcd" and _is_beside_labels(source):
            yield "tumtraf", f"*.pcd beside {' or '.join(LABELS)}"
    for name, suffixes in FILES.items():
        found = next((s for s in suffixes if any(source.glob(f"*{s}"))), None)
        if found:
            yield name, f"*{found}"
    for folder in CLOUD_FOLDERS if labels else ():  # folders of labelCloud and SUSTechPOINTS
        for name, suffixes in {"pcd": (".pcd",), "bin": (".bin",), **CLOUDS_OF_TOOLS}.items():
            found = next((s for s in suffixes if any((source / folder).glob(f"*{s}"))), None)
            if labels and found and folder not in ("", "points"):
                yield name, f"{folder}/*{found} and {labels.name}/"


def _is_beside_labels(source: Path) -> bool:
    parents = resolved(source).parents[:2]
    return any((parent / name).is_dir() for parent in parents for name in LABELS)
