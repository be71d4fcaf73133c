"""
Compiled part of pyinfra; use pyinfra.dataset.simulation.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import pyinfra.core.errors
import typing
__all__: list[str] = ['BackgroundModel', 'ConfigError', 'CropBox', 'CropFieldOfView', 'CropPolygon', 'CropRange', 'Frame', 'FrameStream', 'GroundHeight', 'GroundMorphological', 'GroundPlane', 'IoError', 'Lidar', 'World', 'ball_query', 'farthest_points', 'frames_version', 'kept_rows', 'learn_background', 'reached_voxels', 'shifted_pairs', 'suppress', 'version', 'warnings']
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
    Keeps z > z_m; knows no slope.
    """
    def __init__(self, z_m: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class GroundPlane:
    """
    Removes what is within distance_m of the largest plane that is nearly level (PCL's RANSAC) and sensor_height_m below the sensor, if that is not 0.
    """
    def __init__(self, distance_m: typing.SupportsFloat | typing.SupportsIndex = 0.25, sensor_height_m: typing.SupportsFloat | typing.SupportsIndex = 0.0, max_tilt_deg: typing.SupportsFloat | typing.SupportsIndex = 10.0) -> None:
        ...
class GroundMorphological:
    """
    Removes roads, slopes and terrain: what is wider than window_m, and height_m above it.
    """
    def __init__(self, window_m: typing.SupportsFloat | typing.SupportsIndex = 6.0, height_m: typing.SupportsFloat | typing.SupportsIndex = 0.25, cell_m: typing.SupportsFloat | typing.SupportsIndex = 0.3, azimuth_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.5, max_range_m: typing.SupportsFloat | typing.SupportsIndex = 300.0) -> None:
        ...
class BackgroundModel:
    """
    The static scene as one fixed sensor sees it; as a filter step it removes that scene.
    """
    @staticmethod
    def load(file: str) -> BackgroundModel:
        """
        Raises ConfigError for a file that is not a whole model.
        """
    def save(self, file: str) -> None:
        """
        Writes what `infrasim filter --background` reads.
        """
class Frame:
    """
    What one LiDAR gives for one frame; columns are read-only views.
    """
    def __len__(self) -> int:
        ...
    @property
    def class_id(self) -> numpy.typing.NDArray[numpy.uint16]:
        """
        (n,) uint16.
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
        (k,) structured: every vehicle in reach, box at mid-frame and pose when it was scanned, levelled LiDAR frame.
        """
    @property
    def rays(self) -> int:
        """
        Rays fired in this frame.
        """
    @property
    def ring(self) -> numpy.typing.NDArray[numpy.uint16]:
        """
        (n,) uint16, 0 at the lowest elevation.
        """
    @property
    def seconds(self) -> float:
        """
        Time from rays to columns.
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
        Every key with its value, as YAML.
        """
    def pattern(self, first_frame: typing.SupportsInt | typing.SupportsIndex, last_frame: typing.SupportsInt | typing.SupportsIndex, step: typing.SupportsInt | typing.SupportsIndex, seed: typing.SupportsInt | typing.SupportsIndex | None = None, mount: str = 'pole') -> numpy.typing.NDArray[numpy.float64]:
        """
        (n, 3) float64: azimuth, elevation (rad) and time (s) of every ray, column by column, sensor frame; free motors start as if locked unless a seed is given.
        """
    def period_warnings(self, first_frame: typing.SupportsInt | typing.SupportsIndex, last_frame: typing.SupportsInt | typing.SupportsIndex, step: typing.SupportsInt | typing.SupportsIndex) -> list[str]:
        """
        A line if frames by this step show fewer of its pattern than others would, else none.
        """
    def with_free_motors(self) -> Lidar:
        """
        The same, its turns begun at a draw of the scene's seed, whatever its file says.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def preset(self) -> str:
        ...
class World:
    """
    A scene made ready.
    """
    @staticmethod
    def of_text(text: str, name: str, preset: str = 'datasheet', mount: str = '') -> World:
        """
        A scene that is no file; name stands for one in messages.
        """
    def __init__(self, file: str, assignments: collections.abc.Sequence[str] = [], preset: str = 'datasheet', mount: str = '') -> None:
        ...
    def dump(self) -> str:
        """
        Every key with its value, as YAML.
        """
    def label_time(self, preset: str) -> str:
        """
        frame or scan: when the labels of frames of a preset hold.
        """
    def lidar_yaml(self, lidar: Lidar) -> str:
        """
        What lidar.yaml says of a LiDAR in this scene.
        """
    def mesh(self, frame: typing.SupportsInt | typing.SupportsIndex, share: typing.SupportsFloat | typing.SupportsIndex = 0.5) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint32]]:
        """
        All triangles at one instant of a frame: (n, 3) float32 vertices, (m, 3) uint32; levelled frame.
        """
    def objects(self, frame: typing.SupportsInt | typing.SupportsIndex) -> numpy.ndarray:
        """
        (k,) structured: every object at the middle of a frame, near or far; levelled frame.
        """
    def regions_csv(self) -> str:
        """
        The outlines that narrow the region, as regions.csv has them; empty without any.
        """
    def roads_csv(self) -> str:
        """
        The evaluation region, as roads.csv has it.
        """
    @property
    def frames(self) -> int:
        """
        Frames of 0.1 s in the scene's duration.
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
def ball_query(points: numpy.typing.NDArray[numpy.float32], centres: numpy.typing.NDArray[numpy.float32], radius: typing.SupportsFloat | typing.SupportsIndex, limit: typing.SupportsInt | typing.SupportsIndex) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.uint8]]:
    """
    (m, limit) int64 and (m,) uint8: the first rows of points, (n, 3) float32, that are closer than radius to centres, (m, 3) float32, filled up with the first; 1 where there are none.
    """
def farthest_points(xyz: numpy.typing.NDArray[numpy.float32], count: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
    """
    (count,) int64: rows of xyz, (n, 3) float32 and finite, far from each other, from row 0. Raises ValueError without points and for those that are not finite.
    """
def frames_version() -> int:
    """
    Number of its frames: the same number, the same bytes.
    """
def kept_rows(points: numpy.ndarray, steps: collections.abc.Sequence[CropBox | CropPolygon | CropRange | CropFieldOfView | GroundHeight | GroundPlane | GroundMorphological | BackgroundModel]) -> numpy.typing.NDArray[numpy.int32]:
    """
    (k,) int32, increasing: the rows of points, (n, 3) or (n, 4) float32, levelled LiDAR frame, that every step keeps; never rows that are not finite. Raises ValueError.
    """
def learn_background(frames: collections.abc.Sequence[numpy.ndarray], *, azimuth_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.2, elevation_cell_deg: typing.SupportsFloat | typing.SupportsIndex = 0.2, range_margin_m: typing.SupportsFloat | typing.SupportsIndex = 0.3, height_margin_m: typing.SupportsFloat | typing.SupportsIndex = 0.15) -> BackgroundModel:
    """
    A BackgroundModel from frames of one sensor in one place, each (n, 3) or (n, 4) float32, levelled LiDAR frame. Raises ValueError.
    """
def reached_voxels(coordinates: numpy.typing.NDArray[numpy.int64], shape: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], kernel: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], stride: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], padding: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"], target_shape: typing.Annotated[collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], "FixedSize(3)"]) -> tuple[tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], list[int]], numpy.typing.NDArray[numpy.int64]]:
    """
    (inputs, outputs, counts) as of shifted_pairs for each offset of the kernel, and the increasing keys (m,) int64 of the voxels that a convolution reaches from coordinates, (n, 4) int64, batch z y x within the shape.
    """
def shifted_pairs(keys: numpy.typing.NDArray[numpy.int64], steps: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex]) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], list[int]]:
    """
    Inputs (p,) int64, outputs (p,) int64 and their number for each step: rows with keys[input] = keys[output] + step of increasing keys, (n,) int64.
    """
def suppress(boxes: numpy.typing.NDArray[numpy.float64], iou: typing.SupportsFloat | typing.SupportsIndex, limit: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
    """
    (k,) int64, increasing: rows of boxes, (n, 7) float64, best first, that no kept one overlaps by more than iou; k <= limit.
    """
def version() -> str:
    """
    Version of the simulator.
    """
def warnings(world: World, lidars: collections.abc.Sequence[Lidar]) -> list[str]:
    """
    What a user should know before the frames, as lines.
    """
