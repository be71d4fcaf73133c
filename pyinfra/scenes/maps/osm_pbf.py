"""Converts OpenStreetMap's binary format PBF to XML with the optional package osmium."""

from pathlib import Path

from pyinfra.core.errors import missing
from pyinfra.scenes.maps.lane_map import MapError

PBF = ".pbf"
_BETWEEN = 100_000  # number of elements between two checks of the size of the output


def write_xml(file: Path, out: Path, most_bytes: int) -> None:
    """Writes the elements of a PBF file as OSM XML.

    Raises MapError for a file that is not PBF or has more than `most_bytes` as XML. Raises
    MissingPackage if osmium is not installed.
    """
    try:
        import osmium
    except ImportError as error:
        raise missing("osmium", "pbf") from error
    try:
        with osmium.SimpleWriter(str(out), overwrite=True) as writer:
            elements = osmium.FileProcessor(osmium.io.File(str(file), "pbf"))
            for count, element in enumerate(elements, start=1):
                writer.add(element)
                if count % _BETWEEN == 0 and out.stat().st_size > most_bytes:
                    break
    except RuntimeError as error:
        raise MapError(f"{file}: cannot be read as PBF: {error}") from error
    if out.stat().st_size > most_bytes:
        raise MapError(
            f"{file}: expected up to {most_bytes} bytes as XML, got more; cut the map first, for "
            f"example by `osmium extract -b WEST,SOUTH,EAST,NORTH {file.name} -o site.osm.pbf`"
        )
