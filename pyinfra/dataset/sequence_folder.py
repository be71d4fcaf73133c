"""Writes simulated frames to a LiDAR's folder, in the layout of `infrasim run`."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import AnyArray, Records
from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.object_rows import BOX, type_names
from pyinfra.dataset.outlines import OUTLINES_FILE
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.formats import kitti


def write_folder(frames: SimulatedFrames, data_set: Path, *, fields: bool = True) -> Path:
    """Writes a data set of one LiDAR, and returns the LiDAR's folder.

    fields: whether to write the fields of the points. The folder `data_set` must exist. Boxes are
    rounded to the decimals of the layout. Clouds are
    written unchanged.
    """
    lidar_folder = data_set / frames.name
    lidar_folder.mkdir()
    label_time = frames.label_time
    version, package = frames.versions
    more_keys = (
        f'label_time: {label_time}\npreset: "{frames.unit.preset}"\nversion: "{package}"\n'
        f"frames_version: {version}\n"
    )
    write(data_set / "dataset.yaml", frames.world.dump() + more_keys)
    write(data_set / "roads.csv", frames.world.roads_csv())
    if outlines := frames.world.regions_csv():
        write(data_set / OUTLINES_FILE, outlines)
    write(lidar_folder / "lidar.yaml", frames.world.lidar_yaml(frames.unit))
    for frame in frames:
        objects = objects_of(frames.rows[frame.number])
        with_points = objects.points > 0
        boxes = objects.label_boxes(label_time)[with_points]
        kitti.write_frame(
            lidar_folder,
            frame.number,
            frame.points,
            kitti.Labels(objects.names[with_points], boxes, None),
            objects=objects,
            fields=of_kitti(frame.fields) if fields else None,
        )
    return lidar_folder


def of_kitti(fields: Records | None) -> Records | None:
    """Returns fields (n,) without the column `mount` of fused frames, which the layout lacks."""
    columns = list(kitti.FIELDS.names or ())
    return None if fields is None else fields[columns].astype(kitti.FIELDS)


@contextmanager
def on_disk(frames: FrameSequence, near: Path | None = None) -> Iterator[Path]:
    """Context manager that gives the LiDAR's folder of a sequence.

    Simulated frames are written to a temporary folder in `near`, by default that of the system.
    Raises Error for clouds in memory.
    """
    if isinstance(frames, RecordedFrames):
        yield frames.folder
    elif isinstance(frames, SimulatedFrames):
        with tempfile.TemporaryDirectory(dir=near, prefix=".simulated_") as folder:
            data_set = Path(folder) / (frames.scene or "frames")
            data_set.mkdir()
            yield write_folder(frames, data_set)
    else:
        got = type(frames).__name__
        raise Error(f"frames: expected frames of simulate or load_dataset, got {got}")


def objects_of(rows: AnyArray) -> kitti.Objects:
    """Converts the structured object rows of a simulated frame to `Objects`."""
    copied = "speed points points_in_box distance visibility scan_time_s points_in_scan_box".split()
    scan = ["scan_x", "scan_y", "scan_z", "dx", "dy", "dz", "scan_heading"]
    boxes, scan_boxes = (
        np.stack([rows[name].astype(np.float64) for name in names], axis=1).reshape(-1, 7)
        for names in (BOX, scan)
    )
    return kitti.Objects(
        ids=rows["id"].astype(np.int64),
        names=type_names(rows),
        boxes=boxes,
        scan_boxes=scan_boxes,
        pitch=rows["pitch"] if "pitch" in (rows.dtype.names or ()) else None,
        **{name: rows[name] for name in copied},
    )
