"""Damaged recordings are read, or refused with an error that a user can act on."""

import json
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from recording_files import road, write_bag, write_packets
from test_beam_tables import HESAI, ouster, velodyne, veloview
from test_city_json import city
from test_cloud_files import write_csv, write_las, write_ply
from test_label_files import FRAMES, PLAIN, label_cloud, label_cloud_corners, one_csv, sustech
from test_lanelet2 import lanelets

from pyinfra.core.errors import Error
from pyinfra.exchange.beam_tables import read_beam_table
from pyinfra.exchange.formats import reader
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.recording import Options
from pyinfra.exchange.tool_labels import has_degrees, read_label_cloud, read_sustech
from pyinfra.formats.box_csv import read_box_csv
from pyinfra.scenes.maps.city_json import read_city_json
from pyinfra.scenes.maps.lanelet2_map import read_lanelets

FEW, MANY = 12, 2000
SLOWEST_S = 20.0
SPECIAL = (b"\0", b"\xff", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"nan", b"-1", b"1e400", b"\n")
Make = Callable[[Path], Path]


def bag(storage: str) -> Make:
    def make(folder: Path) -> Path:
        name = "a.bag" if storage == "bag" else "street"
        path = write_bag(folder / name, storage, "hesai", 2)  # type: ignore[arg-type]
        return path if storage == "bag" else next(path.glob(f"*.{storage}"))

    return make


def cloud(name: str, write: Callable[[Path], None]) -> Make:
    def make(folder: Path) -> Path:
        write(folder / name)
        return folder / name

    return make


def text(name: str, content: str) -> Make:
    return cloud(name, lambda file: file.write_text(content) and None)


def labels(write: Callable[[Path], object], name: str) -> Make:
    def make(folder: Path) -> Path:
        write(folder / "source")
        return folder / "source" / name

    return make


SEEDS: dict[str, Make] = {
    **{storage: bag(storage) for storage in ("bag", "mcap", "db3")},
    "las": cloud("a.las", lambda f: write_las(f, road(0, 60))),
    "laz": cloud("a.laz", lambda f: write_las(f, road(0, 60))),
    "ply": cloud("a.ply", lambda f: write_ply(f, road(0, 60), "binary_little_endian")),
    "ply ascii": cloud("a.ply", lambda f: write_ply(f, road(0, 60), "ascii")),
    "csv": cloud("a.csv", lambda f: write_csv(f, road(0, 60), "x,y,z,intensity\n", ",")),
    "pcap": lambda folder: write_packets(folder / "a.pcap", 2),
    "ouster": text("a.json", ouster(True)),
    "velodyne": text("a.yaml", velodyne()),
    "veloview": text("a.xml", veloview()),
    "hesai": text("a.csv", HESAI),
    "labelCloud": labels(label_cloud(degrees=True), "labels/000004.json"),
    "corners": labels(label_cloud_corners, "labels/000004.json"),
    "SUSTechPOINTS": labels(sustech, "label/000004.json"),
    "boxes": labels(one_csv(PLAIN, FRAMES, {}), "boxes.csv"),
    "Lanelet2": lambda folder: lanelets(folder / "a.osm", local=True),
    "CityJSON": text("a.json", json.dumps(city())),
}
READERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("ouster", "velodyne", "veloview", "hesai"), read_beam_table),
    "labelCloud": lambda file: read_label_cloud(file, degrees=has_degrees([file])),
    "corners": lambda file: read_label_cloud(file, degrees=False),
    "SUSTechPOINTS": lambda file: read_sustech(file, {}),
    "boxes": read_box_csv,
    "Lanelet2": lambda file: read_lanelets(file, None),
    "CityJSON": read_city_json,
}


def damaged(data: bytes, random_: random.Random) -> bytes:
    """Cuts, doubles or overwrites pieces of a file; half of the damages are in its first part."""
    out = bytearray(data)
    for _ in range(random_.randint(1, 4)):
        most = len(out) if random_.random() < 0.5 else min(len(out), 600)
        at, size = random_.randrange(max(most, 1)), random_.choice((1, 1, 2, 4, 8, 100))
        match random_.randrange(5):
            case 0:
                del out[at : at + size]
            case 1:
                out[at:at] = out[at : at + size]
            case 2:
                out[at : at + size] = random_.randbytes(size)
            case 3:
                special = random_.choice(SPECIAL)
                out[at : at + len(special)] = special
            case 4:
                del out[random_.randrange(max(len(out), 1)) :]
    return bytes(out)


def read_all(file: Path) -> None:
    format, _ = guess_format(file)
    recording = reader(format)(file, Options())
    if recording.notes is not None:
        recording.notes()
    if recording.times is not None:
        recording.times()
    for i in range(min(len(recording.names), 3)):
        recording.read(i)


def check(name: str, folder: Path, count: int) -> None:
    file = SEEDS[name](folder)
    data, random_ = file.read_bytes(), random.Random(name)
    for number in range(count):
        mutant = file.with_name(f"mutant{file.suffix}")
        mutant.write_bytes(damaged(data, random_))
        message = "read"
        since = time.perf_counter()
        try:
            READERS.get(name, read_all)(mutant)
        except (Error, OSError) as error:
            message = str(error)
        except BaseException as error:
            error.add_note(f"mutant {number} of {name}")
            raise
        assert message
        assert time.perf_counter() - since < SLOWEST_S, f"mutant {number} of {name}"


@pytest.mark.parametrize("name", SEEDS)
def test_some_mutants(name: str, tmp_path: Path) -> None:
    check(name, tmp_path, FEW)


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", SEEDS)
def test_many_mutants(name: str, tmp_path: Path) -> None:
    check(name, tmp_path, MANY)
