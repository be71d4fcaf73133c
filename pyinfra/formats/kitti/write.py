"""Writers for the KITTI layout. Files are written atomically, so they are complete or absent.

Reading a cloud and writing it again gives the same bytes. Text files give the same numbers, up to
the decimals of the layout.
"""

from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, Points, Records
from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.formats.kitti.camera import Calibration, boxes_to_camera, calibration_text, simulated
from pyinfra.formats.kitti.layout import (
    FARTHEST_M,
    FIELDS,
    OBJECT_COLUMNS,
    PITCH_COLUMN,
    Labels,
    Objects,
    Part,
    frame_file,
)
from pyinfra.formats.kitti.read import (
    OBJECT_NUMBERS,
    OBJECT_RULES,
    PITCHED_HEADER,
    PITCHED_RULES,
)
from pyinfra.formats.text_table import columns_of, violations

# Format of a line with the values of OBJECT_COLUMNS.
_OBJECT_LINE = (
    "{},{}" + ",{:.4f}" * 6 + ",{:.6f},{:.4f},{},{}" + ",{:.4f}" * 5 + ",{:.6f},{:.6f},{}"
)
_IMAGE_BOX = (0, 0, 50, 50)  # 2-D box, pixels; KITTI's devkit ignores boxes lower than 25 pixels


def write_points(file: Path, points: Points) -> None:
    """Writes points (n, 4) float32, x y z intensity.

    Raises Error for another shape or type, and for points beyond 10 km.
    """
    if points.dtype != np.float32 or points.ndim != 2 or points.shape[1] != 4:
        raise Error(f"points: expected (n, 4) float32, got {points.shape} {points.dtype}")
    near = (np.abs(points) <= FARTHEST_M).all(axis=1)
    if not near.all():
        row = int(near.argmin())
        raise Error(
            f"points: row {row}: expected finite values within 10 km, got {points[row].tolist()}"
        )
    write(file, np.ascontiguousarray(points, dtype="<f4").tobytes())


def write_fields(file: Path, fields: Records) -> None:
    """Writes the additional fields of points, records (n,) of FIELDS.

    Raises Error for another shape or type.
    """
    if fields.dtype != FIELDS or fields.ndim != 1:
        raise Error(f"fields: expected (n,) {FIELDS}, got {fields.shape} {fields.dtype}")
    write(file, fields.tobytes())


def write_objects(file: Path, objects: Objects) -> None:
    """Writes the objects of a frame. The last column is `pitch` if the objects have a pitch.

    Raises Error for values that `read_objects` would reject.
    """
    o = objects
    pose = o.scan_boxes[:, [0, 1, 2, 6]]
    values = [*o.boxes.T, o.speed, o.points, o.points_in_box, o.distance, o.visibility]
    values += [*pose.T, o.scan_time_s, o.points_in_scan_box]
    header, rules, line = ",".join(OBJECT_COLUMNS), OBJECT_RULES, _OBJECT_LINE
    if o.pitch is not None:
        header, rules, line = PITCHED_HEADER, PITCHED_RULES, f"{line},{{:.6f}}"
        values.append(o.pitch)
    column = columns_of(np.column_stack([o.ids, *values]), (*OBJECT_NUMBERS, PITCH_COLUMN))
    for name, allowed, wrong in violations(column, rules):
        if wrong.any():
            row = int(wrong.argmax())
            raise Error(
                f"objects: {name}: expected {allowed}, got {column(name)[row]:g} for object {row}"
            )
    known, repeats = np.unique(o.ids[o.ids >= 0], return_counts=True)
    if (repeats > 1).any():
        raise Error(f"objects: expected each id once per frame, got {known[repeats > 1][0]} twice")
    rows = zip(o.ids, o.names, *values, strict=True)
    lines = [header, *(line.format(*row) for row in rows)]
    write(file, "".join(f"{line}\n" for line in lines))


def write_labels(file: Path, labels: Labels, calibration: Calibration | None = None) -> None:
    """Writes labels, or predictions if they have scores, in the calibration's camera frame.

    The default calibration is that of a simulated LiDAR. Truncation, occlusion, alpha and image
    box come from `labels.image`. If `labels.image` is None, truncation and occlusion are 0, alpha
    is the observation angle, and the image box has 50 x 50 pixels.
    Raises Error for numbers that are not finite, and for sizes of 0 or less.
    """
    camera = boxes_to_camera(labels.boxes, calibration or simulated())
    image = image_columns(camera) if labels.image is None else labels.image
    scores = np.empty((len(labels), 0)) if labels.scores is None else labels.scores[:, None]
    values = np.column_stack([camera, image, scores])
    if not np.isfinite(values).all():
        raise Error(f"labels: expected finite values, got {values[~np.isfinite(values)][0]}")
    sizes = labels.boxes[labels.names != "DontCare", 3:6]
    if (sizes <= 0).any():
        raise Error(f"boxes: expected sizes above 0, got {sizes.min():g}")
    lines = []
    for name, i, c, s in zip(labels.names, image, camera, scores, strict=True):
        words = [f"{i[0]:.2f}", f"{i[1]:.0f}", f"{i[2]:.6f}", *(f"{v:.2f}" for v in i[3:])]
        words += [*(f"{v:.4f}" for v in c[:6]), f"{c[6]:.6f}", *(f"{v:.6f}" for v in s)]
        lines.append(" ".join([str(name), *words]))
    write(file, "".join(f"{line}\n" for line in lines))


def write_calibration(file: Path, calibration: Calibration | None = None) -> None:
    """Writes a calib file. The default calibration is that of a simulated LiDAR."""
    write(file, calibration_text(calibration or simulated()).encode())


def write_frame(
    lidar_folder: Path,
    frame: int,
    points: Points,
    labels: Labels,
    *,
    objects: Objects | None = None,
    fields: Records | None = None,
    calibration: Calibration | None = None,
) -> None:
    """Writes all parts of a frame. The cloud is written last, because it marks a complete frame.

    Missing folders are created. Raises the errors of the functions that write the parts.
    """

    def path_of(part: Part) -> Path:
        file = frame_file(lidar_folder, part, frame)
        file.parent.mkdir(parents=True, exist_ok=True)
        return file

    write_labels(path_of("label_2"), labels, calibration)
    write_calibration(path_of("calib"), calibration)
    if objects is not None:
        write_objects(path_of("objects"), objects)
    if fields is not None:
        write_fields(path_of("fields"), fields)
    write_points(path_of("velodyne"), points)


def image_columns(camera: FloatArray) -> FloatArray:
    """Returns truncated occluded alpha x1 y1 x2 y2 (k, 7) for boxes that have no such values."""
    x, z, rotation_y = camera[:, 3], camera[:, 5], camera[:, 6]
    alpha = rotation_y - np.arctan2(x, z)
    alpha = (alpha + np.pi) % (2 * np.pi) - np.pi
    zero = np.zeros_like(alpha)
    return np.column_stack([zero, zero, alpha, np.tile(_IMAGE_BOX, (len(alpha), 1))])
