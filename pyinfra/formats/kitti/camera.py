"""Conversion between the LiDAR frame and KITTI's camera frame (x right, y down, z forward).

KITTI gives a box position as the centre of its bottom face, in the rectified frame of camera 0. The
camera of a simulated LiDAR is at the sensor and looks along x. A `calib` file describes a real
camera. The conventions are those of the devkit (readme of the KITTI object benchmark, Geiger et
al., CVPR 2012).
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.formats.text_table import lines_of

SHAPES = {f"P{i}": (3, 4) for i in range(4)} | {
    "R0_rect": (3, 3),
    "Tr_velo_to_cam": (3, 4),
    "Tr_imu_to_velo": (3, 4),
}
# Maps names of matrices in KITTI's tracking and odometry benchmarks to the names in SHAPES. In the
# odometry benchmark, Tr maps from the LiDAR to the rectified camera.
OTHER_NAMES = {
    "R_rect": "R0_rect",
    "Tr_velo_cam": "Tr_velo_to_cam",
    "Tr_imu_velo": "Tr_imu_to_velo",
    "Tr": "Tr_velo_to_cam",
}
# Names of entries of KITTI's road benchmark and raw data. Their lines are ignored.
NOT_NEEDED = ("Tr_cam_to_road", "calib_time")
_NOT_A_ROTATION = 0.01  # tolerance of each element of R R^T - I, for a rotation matrix R
_MOST = 1e6  # largest absolute value in a matrix, in pixels or metres


@dataclass(frozen=True, eq=False)
class Calibration:
    """The seven matrices of a calib file.

    Matrices that the conversion of boxes does not need may have default values.
    """

    P: FloatArray  # (4, 3, 4) projection matrices of the four cameras, pixels
    R0_rect: FloatArray  # (3, 3) rotation that rectifies camera coordinates
    Tr_velo_to_cam: FloatArray  # (3, 4) transform from the LiDAR to the camera
    Tr_imu_to_velo: FloatArray  # (3, 4) transform from the IMU to the LiDAR

    @property
    def T_camera_lidar(self) -> FloatArray:
        """Returns the transform (4, 4) from the LiDAR frame to the rectified camera frame."""
        out = np.eye(4)
        out[:3] = self.R0_rect @ self.Tr_velo_to_cam
        return out


def simulated() -> Calibration:
    """Returns the calibration of `infrasim run`.

    The camera has 1200 x 360 pixels, is at the sensor, and looks along x.
    """
    projection = [[700, 0, 600, 0], [0, 700, 180, 0], [0, 0, 1, 0]]
    return Calibration(
        P=np.array([projection] * 4, dtype=np.float64),
        R0_rect=np.eye(3),
        Tr_velo_to_cam=np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]], dtype=np.float64),
        Tr_imu_to_velo=np.eye(3, 4),
    )


def read_calibration(file: Path) -> Calibration:
    """Reads a calib file of KITTI's object, tracking or odometry benchmark.

    The function replaces a missing projection with the projection of another camera, because the
    conversion of boxes does not need projections. A missing Tr_imu_to_velo becomes the identity.
    Raises FormatError with file and line.
    """
    matrices: dict[str, FloatArray] = {}
    rectified = False  # whether the LiDAR-to-camera transform includes the rectification
    for number, line in enumerate(lines_of(file), start=1):
        if not line.strip():
            continue
        # The colon after the name is optional, because lines of the tracking benchmark may lack it.
        key, _, rest = line.strip().partition(":" if ":" in line else " ")
        where, word = f"{file}:{number}", key.strip()
        if word in NOT_NEEDED:
            continue
        name = OTHER_NAMES.get(word, word)
        if name not in SHAPES:
            raise FormatError(
                f"{where}: expected one of the names {', '.join([*SHAPES, *OTHER_NAMES])}; "
                f"got '{line[:40]}'"
            )
        if name in matrices:
            raise FormatError(f"{where}: {name}: expected the matrix once, got it twice")
        matrices[name] = _matrix(where, name, rest)
        rectified = rectified or word == "Tr"
    if rectified:
        matrices.setdefault("R0_rect", np.eye(3))
    matrices.setdefault("Tr_imu_to_velo", np.eye(3, 4))
    projections = [matrices[f"P{i}"] for i in (2, 0, 1, 3) if f"P{i}" in matrices]
    missing = [] if projections else ["P2"]
    missing += [name for name in ("R0_rect", "Tr_velo_to_cam") if name not in matrices]
    if missing:
        raise FormatError(f"{file}: expected the matrices {', '.join(missing)}; got none of them")
    out = Calibration(
        np.stack([matrices.get(f"P{i}", projections[0]) for i in range(4)]),
        matrices["R0_rect"],
        matrices["Tr_velo_to_cam"],
        matrices["Tr_imu_to_velo"],
    )
    rotation = out.T_camera_lidar[:3, :3]
    off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if off > _NOT_A_ROTATION or np.linalg.det(rotation) < 0:
        raise FormatError(
            f"{file}: R0_rect, Tr_velo_to_cam: expected rotation matrices, got matrices with "
            f"the product {rotation.round(3).tolist()}"
        )
    return out


def calibration_text(calibration: Calibration) -> str:
    """Returns the text of a calib file, with the matrices in the devkit's order."""
    matrices = {f"P{i}": calibration.P[i] for i in range(4)}
    matrices |= {name: getattr(calibration, name) for name in list(SHAPES)[4:]}
    return "".join(
        f"{name}: {' '.join(f'{value:.15g}' for value in matrix.ravel())}\n"
        for name, matrix in matrices.items()
    )


def boxes_from_camera(values: FloatArray, calibration: Calibration) -> FloatArray:
    """Converts h w l x y z rotation_y (k, 7) of label files to LiDAR-frame boxes (k, 7)."""
    h, w, l, x, y, z, rotation_y = values.T  # noqa: E741
    T_lidar_camera = np.linalg.inv(calibration.T_camera_lidar)
    middle = np.stack([x, y - h / 2, z], axis=1)
    centre = middle @ T_lidar_camera[:3, :3].T + T_lidar_camera[:3, 3]
    ahead = np.stack([np.cos(rotation_y), np.zeros_like(x), -np.sin(rotation_y)], axis=1)
    ahead = ahead @ T_lidar_camera[:3, :3].T
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    return np.column_stack([centre, l, w, h, heading])


def boxes_to_camera(boxes: FloatArray, calibration: Calibration) -> FloatArray:
    """Inverts `boxes_from_camera`. The result is exact if the camera's y axis is vertical."""
    T_camera_lidar = calibration.T_camera_lidar
    middle = boxes[:, :3] @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
    heading = boxes[:, 6]
    ahead = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=1)
    ahead = ahead @ T_camera_lidar[:3, :3].T
    rotation_y = np.arctan2(-ahead[:, 2], ahead[:, 0])
    dx, dy, dz = boxes[:, 3], boxes[:, 4], boxes[:, 5]
    x, y, z = middle.T
    return np.column_stack([dz, dy, dx, x, y + dz / 2, z, rotation_y])


def _matrix(where: str, name: str, text: str) -> FloatArray:
    shape = SHAPES[name]
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError:
        raise FormatError(f"{where}: {name}: expected numbers, got '{text.strip()[:40]}'") from None
    if values.size != math.prod(shape) or not (np.abs(values) <= _MOST).all():
        count = math.prod(shape)
        worst = values[~(np.abs(values) <= _MOST)]
        got = f"{worst[0]:g}" if values.size == count else f"{values.size} numbers"
        raise FormatError(
            f"{where}: {name}: expected {count} finite numbers up to {_MOST:g}, got {got}"
        )
    return values.reshape(shape)
