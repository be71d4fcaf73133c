"""Makes tables of the formats of files, from the code that reads and writes them."""

from pyinfra.exchange.formats import FORMATS
from pyinfra.exchange.guess import FILES
from pyinfra.exchange.label_files import SUFFIXES
from pyinfra.scenes.maps.mesh_import import ENDINGS
from pyinfra.scenes.maps.osm_pbf import PBF
from reproduction.tables.common import Rows, markdown, with_heads

# File name endings of formats whose recordings are folders. FILES has the endings of other formats.
FOLDERS = {
    **dict.fromkeys(("kitti", "bin"), ".bin"),
    **dict.fromkeys(("pcd", "dair-v2x", "tumtraf", "rcooper"), ".pcd"),
    "nuscenes": ".json, .pcd.bin",
    "openpcdet": ".npy, .bin",
    "mmdet3d": ".bin, .pkl",
    "openlabel": ".json, .bin",
    "mcap": ".mcap",
}
OWN = "NumPy"


@with_heads("format", "files", "read", "written", "read back as", "library")
def formats() -> Rows:
    """Returns a table with a row for each format of recordings."""
    for name, format in FORMATS.items():
        files = FOLDERS.get(name) or ", ".join(FILES[name])
        read, written = ("yes" if part else "no" for part in (format.read, format.export))
        back = f"`{format.back}`" if format.back else "-"
        extra = f" (extra `{format.extra}`)" if format.extra else ""
        library = f"{format.packages}{extra}" if format.packages else OWN
        yield (f"`{name}`", files, read, written, back, library)


def other_formats() -> str:
    """Returns a table with a row for each other kind of file that commands read."""
    maps = {
        ".xodr": "Eclipse SUMO (extra `site`)",
        ".net.xml": "Eclipse SUMO (extra `site`)",
        ".osm, .osm.xml": "Eclipse SUMO (extra `site`)",
        f".osm{PBF}": "osmium, Eclipse SUMO (extras `pbf`, `site`)",
    }
    maps[".osm of Lanelet2"] = "no traffic of SUMO"
    rows = [("maps", "pyinfra site import", files, library) for files, library in maps.items()]
    rows += [
        ("meshes", "pyinfra site mesh", ", ".join(ENDINGS), "trimesh (extra `site`)"),
        ("tracks", "pyinfra site trajectories", ".csv, .xml of SUMO", OWN),
        ("labels", "pyinfra import", ", ".join(SUFFIXES), OWN),
        ("boxes of a detector", "pyinfra import --boxes-of", ".csv", OWN),
        ("boxes of a detector", "pyinfra evaluate", ".txt, .csv", OWN),
        ("beams of a LiDAR", "pyinfra lidars --from-table", ".json, .yaml, .xml, .csv", OWN),
    ]
    lines = [(what, f"`{command}`", files, library) for what, command, files, library in rows]
    return markdown(["what", "command", "files", "library"], lines)
