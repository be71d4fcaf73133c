"""`pyinfra detect` reads a cloud as the import of its recording does."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import road

from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.lone_clouds import CHECKED, cloud_reader, following_reader
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd

KINDS = ("bin", "pcd")
# Intensities of a sensor, from those between 0 and 1.
SCALES = {
    "shares": lambda i: i,
    "bytes": lambda i: np.round(i * 255),
    "bytes as decimals": lambda i: i * 255,
    "16 bits": lambda i: np.round(i * 65535),
}


def write(folder: Path, kind: str, clouds: list[np.ndarray]) -> list[Path]:
    folder.mkdir()
    files = [folder / f"{k:06d}.{kind}" for k in range(len(clouds))]
    for file, cloud in zip(files, clouds, strict=True):
        fields = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
        if kind == "bin":
            cloud.astype("<f4").tofile(file)
        else:
            write_pcd(file, np.rec.fromarrays(cloud.astype("<f4").T, dtype=fields))
    return files


def clouds_of(scale: str, count: int = 8) -> list[np.ndarray]:
    """Returns clouds with an outlier, a missing intensity, a negative one, and a lost return."""
    clouds = []
    for k in range(count):
        cloud = road(k, 4000)
        cloud[:, 3] = SCALES[scale](cloud[:, 3])
        cloud[0, 3] = 1.2 * cloud[:, 3].max()
        cloud[1, 3], cloud[2, 3] = np.nan, -0.5
        cloud[3, :3] = 0
        clouds.append(cloud)
    return clouds


def imported(files: list[Path], kind: str, out: Path) -> list[np.ndarray]:
    facts = LidarFacts("pole", "street")
    import_recording(files[0].parent, kind, out, facts, Options(), upright="as-is")
    return [kitti.read_points(kitti.frame_file(out, "velodyne", k)) for k in range(len(files))]


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("kind", KINDS)
def test_clouds_are_read_as_in_an_import(kind: str, scale: str, tmp_path: Path) -> None:
    files = write(tmp_path / "source", kind, clouds_of(scale))
    want = imported(files, kind, tmp_path / "in/pole")
    read, notes = cloud_reader(files)
    following = following_reader()
    for file, points in zip(files, want, strict=True):
        assert 0 <= points[:, 3].min() <= points[:, 3].max() <= 1
        assert np.array_equal(read(file), points)
        assert np.array_equal(cloud_reader([file])[0](file), points)
        assert np.array_equal(following(file), points)
    assert any("intensities are divided by" in note for note in notes) == (scale != "shares")


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_clouds_decide_the_scale_of_later_ones(kind: str, tmp_path: Path) -> None:
    """An empty first cloud decides nothing. Later ones are darker, or brighter."""
    first = [np.empty((0, 4), np.float32), *clouds_of("bytes", CHECKED)]
    dark, bright = road(7, 4000), road(8, 4000)
    bright[:, 3] *= 4095
    files = write(tmp_path / "source", kind, [*first, dark, bright])
    read = following_reader()
    points = [read(file) for file in files]
    assert np.median(points[1][:, 3]) == pytest.approx(np.median(road(0, 4000)[:, 3]), abs=0.01)
    assert np.array_equal(points[-2][:, 3], dark[:, 3] / np.float32(255))
    assert np.array_equal(points[-1][:, 3], np.minimum(bright[:, 3] / np.float32(255), 1))


def test_an_arrived_cloud_may_be_removed(tmp_path: Path) -> None:
    read = following_reader()
    for file in write(tmp_path / "source", "bin", clouds_of("bytes", 3)):
        assert read(file)[:, 3].max() == 1
        file.unlink()
