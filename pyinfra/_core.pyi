"""
Compiled part of pyinfra; use pyinfra.sim.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
__all__: list[str] = ['ConfigError', 'Frame', 'FrameStream', 'IoError', 'Lidar', 'World', 'version']
class ConfigError(ValueError):
    pass
class IoError(OSError):
    pass
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
        (k,) structured: every vehicle in reach, box at mid-frame, levelled LiDAR frame.
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
    def pattern(self, first_frame: typing.SupportsInt | typing.SupportsIndex, last_frame: typing.SupportsInt | typing.SupportsIndex, seed: typing.SupportsInt | typing.SupportsIndex | None = None) -> numpy.typing.NDArray[numpy.float64]:
        """
        (n, 3) float64: azimuth, elevation (rad) and time (s) of every ray, in firing order, sensor frame; phase 0 unless a seed is given.
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
    def __init__(self, file: str, assignments: collections.abc.Sequence[str] = []) -> None:
        ...
    def dump(self) -> str:
        """
        Every key with its value, as YAML.
        """
    def mesh(self, frame: typing.SupportsInt | typing.SupportsIndex, share: typing.SupportsFloat | typing.SupportsIndex = 0.5) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint32]]:
        """
        All triangles at one instant of a frame: (n, 3) float32 vertices, (m, 3) uint32; levelled frame.
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
def version() -> str:
    """
    Version of the simulator.
    """
