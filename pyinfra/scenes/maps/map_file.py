"""Determines format, size, digest and compression of map files."""

import bz2
import gzip
import hashlib
import os
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.scenes.maps.osm_pbf import PBF, write_xml

LONGEST_BYTES = 2 << 30  # maximum size of a map file
FORMATS = (".xodr", ".osm", ".osm.xml", ".net.xml")  # .gz or .bz2 may follow these extensions
PACKED = (".gz", ".bz2")
_MESH = "add it to a site of this place as a mesh (`pyinfra site mesh`)"
# Formats that have buildings but no lanes, with the advice for the user.
OTHERS = {
    ".city.json": f"CityJSON has buildings; {_MESH}",
    ".cityjson": f"CityJSON has buildings; {_MESH}",
    ".json": f"CityJSON has buildings; {_MESH}",
    ".gml": f"CityGML has buildings; convert it with citygml-tools to CityJSON, and {_MESH}",
    **dict.fromkeys((".obj", ".glb", ".gltf", ".stl", ".ply"), f"a mesh has no lanes; {_MESH}"),
}


def format_of(file: Path) -> str:
    """Returns the extension of the map format, without the extension of the compression.

    Raises MapError.
    """
    name = file.name.lower()
    if name.endswith(".o5m"):
        stem = file.stem.removesuffix(".osm")
        raise MapError(
            f"{file}: expected XML, got a .o5m file; convert it first, for example with "
            f"`osmconvert {file.name} -o={stem}.osm`"
        )
    if name.endswith(PBF):
        return ".osm"
    for packing in PACKED:
        name = name.removesuffix(packing)
    for ending in FORMATS:
        if name.endswith(ending):
            return ending
    if name.endswith(".xml") and (ending := _BY_ROOT.get(_root_of(file), "")):
        return ending
    for ending, advice in OTHERS.items():
        if name.endswith(ending):
            raise MapError(f"{file}: expected a map with lanes, got a {ending} file: {advice}")
    raise MapError(
        f"{file}: expected a file name that ends in {', '.join(FORMATS)}, optionally followed by "
        f"{' or '.join(PACKED)}, or in .osm{PBF}; got '{file.suffix}'"
    )


def opened(file: Path) -> Any:
    """Opens a file for reading, and decompresses it if it ends in .gz or .bz2."""
    if file.suffix.lower() == ".bz2":
        return bz2.open(file)
    return gzip.open(file) if file.suffix.lower() == ".gz" else file.open("rb")


_BY_ROOT = {"OpenDRIVE": ".xodr", "osm": ".osm", "net": ".net.xml"}


def _root_of(file: Path) -> str:
    """Returns the name of the first XML element, or an empty text if the file has none.

    Raises MapError if the file is not XML.
    """
    try:
        with opened(file) as stream:
            for _, node in ElementTree.iterparse(stream, events=("start",)):
                return str(node.tag).rpartition("}")[2]
    except (ElementTree.ParseError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise MapError(f"{file}: cannot be read as XML: {error}") from error
    return ""


def unpacked(file: Path, kind: str, scratch: Path) -> Path:
    """Returns the file, or a decompressed copy of it. Raises MapError and MissingPackage."""
    if file.suffix.lower() == PBF:
        write_xml(file, out := scratch / "map.osm", LONGEST_BYTES)
        return out
    if file.suffix.lower() not in PACKED:
        return file
    out = scratch / f"map{kind}"
    try:
        with opened(file) as stream, out.open("wb") as into:
            while block := stream.read(1 << 20):
                into.write(block)
                if into.tell() > LONGEST_BYTES:
                    raise MapError(
                        f"{file}: expected up to {LONGEST_BYTES} bytes after unpacking, got more"
                    )
    except (EOFError, zlib.error, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # OS error such as a full disk
            raise OSError(error.errno, os.strerror(error.errno), str(out)) from error
        raise MapError(f"{file}: cannot be unpacked: {error}") from error
    return out


def digest(file: Path) -> str:
    size = file.stat().st_size
    if not 0 < size <= LONGEST_BYTES:
        raise MapError(f"{file}: expected 1 to {LONGEST_BYTES} bytes, got {size} bytes")
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
