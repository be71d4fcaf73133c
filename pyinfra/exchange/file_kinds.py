"""Recognises files of other formats by their first bytes, and says what to do with them."""

from dataclasses import dataclass
from pathlib import Path

HEAD_BYTES = 512


@dataclass(frozen=True)
class FileKind:
    """A kind of file: its name, and the import format that reads it, or advice to the user."""

    name: str
    format: str = ""  # a key of FORMATS; empty if the import cannot read such files
    advice: str = ""


_CLOUD = "save the points as .pcd, .las or .ply, for example with CloudCompare or PDAL"
_ARCHIVE = "unpack the archive and import the folder"
_ARRAYS = "save each frame as .bin: `points.astype('float32').tofile('000000.bin')`"
_PICKLE = FileKind("pickle", "", "pickles are not read, because they can run code; " + _ARRAYS)
# First bytes of a file, and the kind of file that they identify. The first match is used.
MAGIC: tuple[tuple[bytes, FileKind], ...] = (
    (b"\x89MCAP0\r\n", FileKind("MCAP", "bag")),
    (b"#ROSBAG V", FileKind("ROS 1 bag (.bag)", "bag")),
    (b"SQLite format 3\0", FileKind("SQLite, as ROS 2 bags (.db3) are", "bag")),
    (b"\xd4\xc3\xb2\xa1", FileKind("packets (.pcap)", "pcap")),
    (b"\xa1\xb2\xc3\xd4", FileKind("packets (.pcap)", "pcap")),
    (b"\x4d\x3c\xb2\xa1", FileKind("packets (.pcap)", "pcap")),
    (b"\xa1\xb2\x3c\x4d", FileKind("packets (.pcap)", "pcap")),
    (
        b"\x0a\x0d\x0d\x0a",
        FileKind("packets (.pcapng)", "", "convert it: `editcap -F pcap FILE.pcapng FILE.pcap`"),
    ),
    (b"LASF", FileKind("LAS or LAZ", "las")),
    (b"ply\n", FileKind("PLY", "ply")),
    (b"ply\r", FileKind("PLY", "ply")),
    (b"# .PCD", FileKind("PCD", "pcd")),
    (b"VERSION .7", FileKind("PCD", "pcd")),
    (b"VERSION 0.7", FileKind("PCD", "pcd")),
    (b"FIELDS ", FileKind("PCD", "pcd")),
    (b"ASTM-E57", FileKind("E57", "", _CLOUD)),
    (b"\x89HDF\r\n", FileKind("HDF5", "", _ARRAYS)),
    (b"\x93NUMPY", FileKind("NumPy (.npy)", "", _ARRAYS)),
    (b"PK\x03\x04", FileKind("zip archive (also .npz, .xlsx)", "", _ARCHIVE)),
    (b"\x1f\x8b", FileKind("gzip", "", _ARCHIVE)),
    (b"BZh", FileKind("bzip2", "", _ARCHIVE)),
    (b"7z\xbc\xaf", FileKind("7z archive", "", _ARCHIVE)),
    (b"\xfd7zXZ", FileKind("xz", "", _ARCHIVE)),
    (b"Rar!", FileKind("RAR archive", "", _ARCHIVE)),
    (b"\x28\xb5\x2f\xfd", FileKind("zstd", "", _ARCHIVE)),
    (b"PAR1", FileKind("Parquet", "", _ARRAYS)),
    (b"\x80\x04\x95", _PICKLE),
)
SUFFIXES = {
    ".las": "las",
    ".laz": "las",
    ".ply": "ply",
    ".csv": "csv",
    ".txt": "csv",
    ".xyz": "csv",
    ".asc": "csv",
    ".pts": "csv",
    ".pcd": "pcd",
    ".bag": "bag",
    ".mcap": "bag",
    ".db3": "bag",
    ".pcap": "pcap",
}
# Extensions of files that are often beside a recording and are not point clouds.
BESIDE = {".json", ".yaml", ".yml", ".md", ".pkl", ".png", ".jpg", ".jpeg", ".xml", ".html", ".log"}


def kind_of(file: Path) -> FileKind | None:
    """Returns the kind of a file by its first bytes, else by its ending; None if it is unknown."""
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    for magic, kind in MAGIC:
        if head.removeprefix(b"\xef\xbb\xbf").startswith(magic):
            return kind
    if len(head) > 262 and head[257:262] == b"ustar":
        return FileKind("tar archive", "", _ARCHIVE)
    if file.suffix.lower() in (".pkl", ".pickle"):
        return _PICKLE
    format = SUFFIXES.get(file.suffix.lower(), "")
    if format == "csv" and b"\0" not in head:
        return FileKind("text", "csv")
    return FileKind(file.suffix.lower(), format) if format and format != "csv" else None


def found_text(folder: Path) -> str:
    """Describes the content of a folder, as in `street.las (LAS or LAZ) and 3 more`."""
    entries = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    files = [path for path in entries if path.is_file()]
    if not files:
        names = ", ".join(f"{path.name}/" for path in entries[:3])
        return f"the folders {names}" if names else "an empty folder"
    clouds = [file for file in files if file.suffix.lower() not in BESIDE] or files
    kind = kind_of(clouds[0])
    name = f" ({kind.name}" + (f": {kind.advice})" if kind.advice else ")") if kind else ""
    more = f" and {len(entries) - 1} more" if len(entries) > 1 else ""
    return f"{clouds[0].name}{name}{more}"
