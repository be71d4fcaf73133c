"""
Compiled part of pyinfra. Use it through pyinfra.dataset.simulation.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import pyinfra.core.errors
import typing
__all__: list[str] = ['BackgroundModel', 'ConfigError', 'CropBox', 'CropFieldOfView', 'CropPolygon', 'CropRange', 'Frame', 'FrameStream', 'GroundHeight', 'GroundMorphological', 'GroundPlane', 'IoError', 'Lidar', 'Observer', 'World', 'ball_query', 'farthest_points', 'frames_version', 'kept_rows', 'learn_background', 'pillar_map', 'reached_voxels', 'shifted_pairs', 'suppress', 'version', 'warnings']
class ConfigError(pyinfra.core.errors.ConfigError):
    pass
class IoError(OSError):
    pass
class CropBox:
    """
    Keeps min_m <= point <= max_m, each (x, y, z) in metres.
    """
    def __init__(self, min_m: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"], max_m: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"]) -> None:
        ...
class CropPolygon:
    """
    Keeps points inside corners (x, y) in metres.
    """
    def __init__(self, outline_m: collections.abc.Sequence[tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex]]) -> None:
        ...
class CropRange:
    """
    Keeps min_m <= slant range <= max_m.
    """
    def __init__(self, min_m: typing.SupportsFloat | typing.SupportsIndex, max_m: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class CropFieldOfView:
    """
    Keeps an interval of azimuth, from min towards +y up to max, and of elevation; degrees.
    """
    def __init__(self, azimuth_min_deg: typing.SupportsFloat | typing.SupportsIndex = -180.0, azimuth_max_deg: typing.SupportsFloat | typing.SupportsIndex = 180.0, elevation_min_deg: typing.SupportsFloat | typing.SupportsIndex = -90.0, elevation_max_deg: typing.SupportsFloat | typing.SupportsIndex = 90.0) -> None:
        ...
class GroundHeight:
    """
    Keeps points with z > z_m; ignores slopes.
    """
    def __init__(self, z_m: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class GroundPlane:
    """
    Removes points within distance_m of the largest nearly level plane (RANSAC of PCL). If sensor_height_m is not 0, the plane must be this far below the sensor.
    """
    def __init__(self, distance_m: typing.SupportsFloat | typing.SupportsIndex = 0.25, sensor_height_m: typing.SupportsFloat | typing.SupportsIndex = 0.0, max_tilt_deg: typing.SupportsFloat | typing.SupportsIndex = 10.0) -> None:
        ...
class GroundMorphological:
    """
    Removes roads, slopes and terrain: surfaces wider than window_m, and points up to height_m above them.
    """
    def __init__(self, window_m: typing.SupportsFloat | typing.SupportsIndex = 6.0, height_m: typing.SupportsFloat | typing.SupportsIndex = 0.25, cell_m: typing.SupportsFloat | typing.SupportsIndex = 0.3, azimuth_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.5, max_range_m: typing.SupportsFloat | typing.SupportsIndex = 300.0) -> None:
        ...
class BackgroundModel:
    """
    Model of the static scene for one fixed sensor; as a filter step, it removes the points of this scene.
    """
    @staticmethod
    def load(file: str) -> BackgroundModel:
        """
        Reads a saved model. Raises ConfigError if the file is not a complete model.
        """
    def save(self, file: str) -> None:
        """
        Writes a file for `infrasim filter --background`.
        """
class Frame:
    """
    The points and objects of one LiDAR in one frame. Columns are read-only views.
    """
    def __len__(self) -> int:
        ...
    @property
    def class_id(self) -> numpy.typing.NDArray[numpy.uint16]:
        """
        (n,) uint16.
        """
    @property
    def echo(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (n,) uint8, 1 for the second point of a ray, else 0.
        """
    @property
    def intensity(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (n,) float32, [0, 1].
        """
    @property
    def object_id(self) -> numpy.typing.NDArray[numpy.int32]:
        """
        (n,) int32, -1 for background.
        """
    @property
    def objects(self) -> numpy.ndarray:
        """
        (k,) structured: every object in range, with its box at mid-frame and its pose when it was scanned. Levelled LiDAR frame.
        """
    @property
    def rays(self) -> int:
        """
        Number of rays fired in this frame.
        """
    @property
    def ring(self) -> numpy.typing.NDArray[numpy.uint16]:
        """
        (n,) uint16, 0 at the lowest elevation.
        """
    @property
    def seconds(self) -> float:
        """
        Seconds of computation, from the rays to the columns.
        """
    @property
    def time(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (n,) float32, seconds since the start of the frame.
        """
    @property
    def xyz(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (n, 3) float32, metres, levelled LiDAR frame.
        """
class Lidar:
    """
    One preset of a LiDAR file.
    """
    def __init__(self, file: str, preset: str) -> None:
        ...
    def dump(self) -> str:
        """
        Returns every key with its value, as YAML.
        """
    def fields_of_view(self) -> list[typing.Annotated[list[float], "FixedSize(4)"]]:
        """
        Returns azimuth minimum and maximum, then elevation minimum and maximum (deg) of the rays of each unit.
        """
    def pattern(self, first_frame: typing.SupportsInt | typing.SupportsIndex, last_frame: typing.SupportsInt | typing.SupportsIndex, step: typing.SupportsInt | typing.SupportsIndex, seed: typing.SupportsInt | typing.SupportsIndex | None = None, mount: str = 'pole') -> numpy.typing.NDArray[numpy.float64]:
        """
        Returns (n, 3) float64: azimuth, elevation (rad) and time (s) of every ray, column by column, sensor frame. Without a seed, free motors start as if locked.
        """
    def period_warnings(self, first_frame: typing.SupportsInt | typing.SupportsIndex, last_frame: typing.SupportsInt | typing.SupportsIndex, step: typing.SupportsInt | typing.SupportsIndex) -> list[str]:
        """
        Returns one warning if frames with this step show less of the scan pattern than other steps would, else none.
        """
    def with_echo(self, mode: str) -> Lidar:
        """
        Returns a copy whose rays give the strongest, first or last echo as a point, or two (dual).
        """
    def with_every_hit(self) -> Lidar:
        """
        Returns a copy in which each ray that hits something within the maximum range gives a point at the exact range: without loss, noise, width of the beam and further echoes.
        """
    def with_free_motors(self) -> Lidar:
        """
        Returns a copy whose spinning motors start at random angles, derived from the scene's seed.
        """
    def with_law_exponent(self, exponent: typing.SupportsFloat | typing.SupportsIndex) -> Lidar:
        """
        Returns a copy whose range grows in full sun with this power of the reflectance, 0.25 to 0.5. Units with several published ranges keep the exponent that these determine.
        """
    def with_rate(self, rate_hz: typing.SupportsFloat | typing.SupportsIndex) -> Lidar:
        """
        Returns a copy with another number of frames per second, 5 to 20. The firing cycle of a spinning LiDAR does not change, so that its columns per turn do.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def period_s(self) -> float:
        """
        Frame period in seconds.
        """
    @property
    def preset(self) -> str:
        ...
class World:
    """
    A scene that is ready to simulate.
    """
    @staticmethod
    def of_text(text: str, name: str, preset: str = 'datasheet', mount: str = '') -> World:
        """
        Makes a scene from YAML text. Messages use name in place of a file name.
        """
    def __init__(self, file: str, assignments: collections.abc.Sequence[str] = [], preset: str = 'datasheet', mount: str = '') -> None:
        ...
    def drive(self) -> None:
        """
        Simulates the traffic of the whole scene, which is otherwise simulated up to the last frame that was requested. Raises ConfigError if a vehicle hits the sensor.
        """
    def dump(self) -> str:
        """
        Returns every key with its value, as YAML.
        """
    def frames_of(self, period_s: typing.SupportsFloat | typing.SupportsIndex) -> int:
        """
        Returns the number of frames of a period in the scene's duration.
        """
    def label_time(self, preset: str) -> str:
        """
        Returns the label time of a preset: frame or scan.
        """
    def lidar_yaml(self, lidar: Lidar) -> str:
        """
        Returns the content of lidar.yaml for a LiDAR in this scene.
        """
    def mesh(self, frame: typing.SupportsInt | typing.SupportsIndex, share: typing.SupportsFloat | typing.SupportsIndex = 0.5, period_s: typing.SupportsFloat | typing.SupportsIndex = 0.1) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint32]]:
        """
        Returns all triangles at one instant of a frame: (n, 3) float32 vertices and (m, 3) uint32 vertex indices. Levelled frame. share: 0 at the start of the frame, 1 at its end.
        """
    def objects(self, frame: typing.SupportsInt | typing.SupportsIndex, period_s: typing.SupportsFloat | typing.SupportsIndex = 0.1) -> numpy.ndarray:
        """
        Returns (k,) structured: every object of the scene at the middle of a frame, at any distance. Levelled frame.
        """
    def regions_csv(self) -> str:
        """
        Returns the outlines that narrow the region, in the format of regions.csv. Empty without outlines.
        """
    def roads_csv(self) -> str:
        """
        Returns the evaluation region in the format of roads.csv.
        """
    @property
    def frames(self) -> int:
        """
        Number of frames of 0.1 s in the scene's duration.
        """
class FrameStream:
    """
    Iterates over (number, [Frame per LiDAR]), computed ahead by threads.
    """
    def __init__(self, world: World, lidars: collections.abc.Sequence[Lidar], frames: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], threads: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __iter__(self) -> typing.Any:
        ...
    def __next__(self) -> tuple[int, list[Frame]]:
        ...
class Observer:
    """
    What LiDARs see of the objects of one site from many poses. A pose is x, y, z (m, world frame), yaw and pitch (deg). Thread-safe.
    """
    def __init__(self, file: str, assignments: collections.abc.Sequence[str], preset: str, mount: str, frames: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], period_s: typing.SupportsFloat | typing.SupportsIndex = 0.1) -> None:
        ...
    def fault(self, pose: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(5)"]) -> str:
        """
        Returns why no sensor can be at a pose; empty if one can.
        """
    def observe(self, pose: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(5)"], lidars: collections.abc.Sequence[Lidar], frames: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex]) -> numpy.ndarray:
        """
        Returns (n,) structured: each object with points, by frame and LiDAR. Extents are along the axes of the object's box. Raises ConfigError for a pose with a fault.
        """
    def present(self, frames: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex]) -> numpy.ndarray:
        """
        Returns (n,) structured: every object in the evaluation region at the middle of each frame. World frame.
        """
def ball_query(points: numpy.typing.NDArray[numpy.float32], centres: numpy.typing.NDArray[numpy.float32], radius: typing.SupportsFloat | typing.SupportsIndex, limit: typing.SupportsInt | typing.SupportsIndex) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.uint8]]:
    """
    Returns (m, limit) int64, the first rows of points closer than radius to each centre, and (m,) uint8, 1 for a centre without such points. Unused entries repeat the first row. points: (n, 3) float32. centres: (m, 3) float32.
    """
def farthest_points(xyz: numpy.typing.NDArray[numpy.float32], count: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
    """
    Farthest point sampling: returns (count,) int64 rows of xyz, starting with row 0. xyz: (n, 3) float32. Raises ValueError if there are no points or a value is not finite.
    """
def frames_version() -> int:
    """
    Returns the version number of the frames. Equal numbers give equal bytes.
    """
def kept_rows(points: numpy.ndarray, steps: collections.abc.Sequence[CropBox | CropPolygon | CropRange | CropFieldOfView | GroundHeight | GroundPlane | GroundMorphological | BackgroundModel]) -> numpy.typing.NDArray[numpy.int32]:
    """
    Returns (k,) int32, increasing: the rows of points that every step keeps, without rows that are not finite or 0 0 0. points: (n, 3) or (n, 4) float32, levelled LiDAR frame. Raises ValueError.
    """
def learn_background(frames: collections.abc.Sequence[numpy.ndarray], *, azimuth_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.2, elevation_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.2, range_margin_m: typing.SupportsFloat | typing.SupportsIndex = 0.3, height_margin_m: typing.SupportsFloat | typing.SupportsIndex = 0.15) -> BackgroundModel:
    """
    Learns a BackgroundModel from frames of one fixed sensor, each (n, 3) or (n, 4) float32, levelled LiDAR frame. Raises ValueError.
    """
def pillar_map(points: numpy.typing.NDArray[numpy.float32], low: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex], middle_z: typing.SupportsFloat | typing.SupportsIndex, side: typing.SupportsFloat | typing.SupportsIndex, weight: numpy.typing.NDArray[numpy.float32], bias: numpy.typing.NDArray[numpy.float32], first: typing.SupportsInt | typing.SupportsIndex, layer_weight: numpy.typing.NDArray[numpy.float32], layer_bias: numpy.typing.NDArray[numpy.float32], stride: typing.SupportsInt | typing.SupportsIndex, map: numpy.typing.NDArray[numpy.float32]) -> None:
    """
    Overwrites map (outputs, rows, columns) float32 with the first convolution on the pillars of a cloud. points: (n, 3 or more) float32. low, side: x, y of the grid's corner, side of a cell. weight: (inputs, features), bias: (features,) of the linear layer of a point. first: number of inputs that are left out. layer_weight: (9 * features, outputs), layer_bias: (outputs,) of a 3 x 3 convolution.
    """
def reached_voxels(coordinates: numpy.typing.NDArray[numpy.int64], shape: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], kernel: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], stride: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], padding: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], target_shape: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"]) -> tuple[tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], list[int]], numpy.typing.NDArray[numpy.int64]]:
    """
    Returns (inputs, outputs, counts), as shifted_pairs does, for each offset of the kernel, and the increasing keys (m,) int64 of the output voxels of a convolution. coordinates: (n, 4) int64, batch z y x within the shape.
    """
def shifted_pairs(keys: numpy.typing.NDArray[numpy.int64], steps: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex]) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], list[int]]:
    """
    Returns inputs (p,) int64, outputs (p,) int64 and the number of pairs for each step: rows with keys[input] = keys[output] + step. keys: (n,) int64, increasing.
    """
def suppress(boxes: numpy.typing.NDArray[numpy.float64], iou: typing.SupportsFloat | typing.SupportsIndex, limit: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
    """
    Non-maximum suppression: returns (k,) int64, increasing, k <= limit: the rows of boxes that no kept better box overlaps by more than iou. boxes: (n, 7) float64, best first.
    """
def version() -> str:
    """
    Returns the version of the simulator.
    """
def warnings(world: World, lidars: collections.abc.Sequence[Lidar]) -> list[str]:
    """
    Returns warnings about these LiDARs, one line each: tables of angles that look like radians or repeat too soon, and a weather model without effect. Then returns those about the world's trajectories and meshes.
    """
