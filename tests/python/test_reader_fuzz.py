"""A reader reads a file of any bytes, or raises an error that names the file.

Files of an artificial data set are damaged: bytes and lines are removed, doubled, moved and
replaced, also by words with a special meaning as numbers or in YAML. The result must have the
documented form. Otherwise the reader raises an OSError, or a pyinfra.Error (such as FormatError or
ConfigError) that names the file. The damages are always the same, except in `make fuzz`, which
tries other damages for FUZZ_SECONDS per reader.
"""

import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pypcd4
import pytest
import report_data
from evaluation_data import write_roads
from exchange_data import FRAMES, write_recording
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frame_readers import read_cameras, read_predictions, read_vehicles
from pyinfra.dataset.roads import read_roads
from pyinfra.exchange.box_text import read_boxes
from pyinfra.exchange.formats import exporter, reader
from pyinfra.exchange.recording import Options
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.result_tables import read_results
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import read_pcd
from pyinfra.models.detectors.background import Background
from pyinfra.models.training.recipe import read_recipe

SECONDS = float(os.environ.get("FUZZ_SECONDS", "0"))
EXAMPLES = 200 if SECONDS else 40
CONFIGS = Path(__file__).resolve().parents[2] / "configs"
FRAME = 5
NUMBERS = [
    n.encode()
    for n in "nan inf -inf .nan .inf 1e400 3e38 -1 0 1 2 1.5 9 100 360 1e18 1_0 0x10 \u0661".split()
]
WORDS = [
    *(b"null true 'x ~ [] {} &a *a !!python/object:os <<: --- ... Car car DontCare".split()),
    *(b'\0 \xff \xef\xbb\xbf \xe2\x80\xa8 \x85 \x1b[2J \r , ,, : : - # " =1+1 ../x /'.split(b" ")),
    *(b"\n", b"\n\n", b" ", b"\t", b"\x93NUMPY", b"999999999999999999999", b"[" * 2000),
]


@dataclass(frozen=True)
class Damage:
    """A damage to a file: a piece is replaced by a word, removed (0) or doubled (2)."""

    at: float  # position as a share of the file
    piece: str
    new: bytes | int

    def done(self, data: bytes) -> bytes:
        at = int(self.at * len(data))
        line = data.rfind(b"\n", 0, at) + 1, data.find(b"\n", at) + 1 or len(data)
        starts = (match.end() for match in re.finditer(rb"[ ,:\n]", data[:at]))
        end = re.search(rb"[ ,:\n]|$", data[at:])
        cell = max(starts, default=0), at + (end.start() if end else 0)
        pieces = {"nothing": (at, at), "byte": (at, at + 1), "cell": cell, "line": line}
        i, j = pieces.get(self.piece, (at, len(data)))
        new = self.new if isinstance(self.new, bytes) else data[i:j] * self.new
        return data[:i] + new + data[j:]


DAMAGES = st.lists(
    st.builds(
        Damage,
        st.floats(0, 1, exclude_max=True),
        st.sampled_from(["nothing", "byte", "cell", "cell", "line", "rest"]),
        st.one_of(map(st.sampled_from, (NUMBERS, WORDS, [0, 2]))) | st.binary(max_size=4),
    ),
    max_size=4,
)


def finite(*arrays: np.ndarray | None) -> None:
    assert all(np.isfinite(array).all() for array in arrays if array is not None)


def sized(boxes: np.ndarray) -> None:
    finite(boxes)
    assert (boxes[:, 3:6] > 0).all()


def points(file: Path) -> None:
    cloud = kitti.read_points(file)
    finite(cloud)
    assert cloud.shape == (file.stat().st_size / 16, 4)


def objects(file: Path) -> None:
    """Reads one file alone and together with others. Both ways must apply the same checks."""
    alone = bulk = None
    try:
        alone = kitti.read_objects(file)
    finally:
        try:
            bulk = read_vehicles(file.parents[2], [FRAME])
        except Error:
            assert alone is None
        assert (alone is None) == (bulk is None)
    sized(alone.boxes)
    finite(alone.speed, alone.distance)
    assert len(set(alone.ids)) == len(alone)
    assert (alone.points >= 0).all()
    assert ((alone.visibility == -1) | (abs(alone.visibility - 0.5) <= 0.5)).all()


def labels(file: Path) -> None:
    parsed = kitti.read_labels(file)
    sized(parsed.boxes)
    assert "DontCare" not in parsed.names


def calibration(file: Path) -> None:
    parsed = kitti.read_calibration(file)
    finite(parsed.P, parsed.T_camera_lidar, parsed.Tr_imu_to_velo)


def lidar(file: Path) -> None:
    parsed = kitti.read_lidar(file.parent)
    pose = parsed.T_world_levelled
    finite(np.array([pose.x, pose.y, pose.z, pose.yaw]))
    assert 0 < parsed.period_s < 100
    assert parsed.field_of_view


def predictions(file: Path) -> None:
    parsed = read_predictions([file], read_cameras(file.parents[1] / "data/pole", [FRAME]))
    sized(parsed.boxes)
    finite(parsed.scores)


def roads(file: Path) -> None:
    for road in read_roads(file):
        finite(road.s, road.xy, road.heading, road.half_width)
        assert (np.diff(road.s) > 0).all()


def recording(layout: str) -> Callable[[Path], None]:
    def read(file: Path) -> None:
        folder = next(parent for parent in file.parents if parent.name == layout)
        parsed = reader(layout)(folder, Options())
        for i in range(len(parsed.names)):
            frame = parsed.read(i)
            assert frame.points.shape[1] == 4
            sized(frame.boxes.boxes)

    return read


def pcd(file: Path) -> None:
    assert read_pcd(file).dtype.names


def boxes(file: Path) -> None:
    sized(read_boxes(file).boxes)


def results(file: Path) -> None:
    read_results(file.parent)


# Each damaged file, and the reader that reads it.
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "points": (f"data/pole/training/velodyne/{FRAME:06d}.bin", points),
    "fields": (f"data/pole/training/fields/{FRAME:06d}.bin", kitti.read_fields),
    "objects": (f"data/pole/training/objects/{FRAME:06d}.csv", objects),
    "labels": (f"data/pole/training/label_2/{FRAME:06d}.txt", labels),
    "calibration": (f"data/pole/training/calib/{FRAME:06d}.txt", calibration),
    "lidar": ("data/pole/lidar.yaml", lidar),
    "data set": ("data/dataset.yaml", lambda file: read_data_set(file.parent)),
    "data set of a lidar": ("data/pole/lidar.yaml", lambda file: read_data_set(file.parents[1])),
    "roads": ("data/roads.csv", roads),
    "kitti predictions": ("predictions/a.txt", predictions),
    "csv predictions": ("predictions/a.csv", predictions),
    "boxes": (f"pcd/labels/{FRAME:06d}.txt", boxes),
    "ascii pcd": ("clouds/ascii.pcd", pcd),
    "binary pcd": ("clouds/binary.pcd", pcd),
    "compressed pcd": ("clouds/binary_compressed.pcd", pcd),
    "openpcdet cloud": (f"openpcdet/points/{FRAME:06d}.npy", recording("openpcdet")),
    "openpcdet sensor": ("openpcdet/sensor.yaml", recording("openpcdet")),
    "pcd recording": (f"pcd/points/{FRAME:06d}.pcd", recording("pcd")),
    "nuscenes data": ("nuscenes/v1.0-infrasim/sample_data.json", recording("nuscenes")),
    "nuscenes boxes": ("nuscenes/v1.0-infrasim/sample_annotation.json", recording("nuscenes")),
    "nuscenes poses": ("nuscenes/v1.0-infrasim/ego_pose.json", recording("nuscenes")),
    "background": ("background.npz", Background.load),
    "results": ("results/quick.csv", results),
    "recipe": ("pointpillars.yaml", lambda file: read_recipe(file, "quick")),
    "plan": ("paper.yaml", lambda file: read_plan(file, "quick")),
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes undamaged files. Each of them can be read."""
    folder = tmp_path_factory.mktemp("site")
    pole = write_recording(folder / "data")
    write_roads(folder / "data")
    for layout in ("openpcdet", "pcd", "nuscenes"):
        (folder / layout).mkdir()
        exporter(layout)(pole, list(FRAMES), folder / layout)
    (folder / "predictions").mkdir()
    label = kitti.frame_file(pole, "label_2", FRAME).read_text()
    (folder / "predictions/a.txt").write_text(label.replace("\n", " 0.5\n"))
    (folder / "predictions/a.csv").write_text(
        "class,x,y,z,dx,dy,dz,heading,score\nCar,9,-4,-5,4,2,1.5,0.5,0.9\nBus,20,6,-4,9,2.5,3,3,0.1\n"
    )
    (folder / "clouds").mkdir()
    cloud = pypcd4.PointCloud.from_xyzi_points(np.arange(40, dtype=np.float32).reshape(10, 4))
    for encoding in pypcd4.Encoding:
        cloud.save(folder / f"clouds/{encoding.value}.pcd", encoding)
    report_data.write(folder / "results", {"quick.csv": report_data.experiments()})
    Background.learn([kitti.read_points(kitti.frame_file(pole, "velodyne", FRAME))]).save(
        folder / "background.npz"
    )
    for name in ("detectors/pointpillars.yaml", "benchmarks/paper.yaml"):
        (folder / Path(name).name).write_bytes((CONFIGS / name).read_bytes())
    return folder


@pytest.mark.parametrize("name", READERS)
@pytest.mark.timeout(300 + 2 * SECONDS)
def test_a_damaged_file_is_read_or_named(name: str, site: Path) -> None:
    relative, read = READERS[name]
    file = site / relative
    whole = file.read_bytes()
    read(file)

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        derandomize=not SECONDS,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(DAMAGES)
    def try_some(damages: list[Damage]) -> None:
        data = whole
        for damage in damages:
            data = damage.done(data)
        file.write_bytes(data)
        try:
            read(file)
        except OSError:
            pass
        except Error as error:
            assert str(site) in str(error), error  # noqa: PT017

    try:
        end = time.monotonic() + SECONDS
        try_some()
        while time.monotonic() < end:
            try_some()
    finally:
        file.write_bytes(whole)
