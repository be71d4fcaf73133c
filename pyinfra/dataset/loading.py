"""Public functions that load scenes, LiDARs and frames by name or file."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt
import yaml

from pyinfra.core.arrays import Float32Array
from pyinfra.core.errors import ConfigError, Error, check_exists
from pyinfra.core.names import file_or_name, path_of
from pyinfra.core.public import public
from pyinfra.core.vocabulary import Preset
from pyinfra.dataset.box_tables import on_cpu
from pyinfra.dataset.catalogue import configs, shipped
from pyinfra.dataset.frame_sequence import (
    ArrayFrames,
    FrameSequence,
    LidarFrame,
    RecordedFrames,
)
from pyinfra.dataset.frames import frame_numbers, lidars_in
from pyinfra.dataset.own_files import own_file
from pyinfra.formats.ply import Triangles, write_ply
from pyinfra.formats.yaml_file import read_keys

if TYPE_CHECKING:
    from pyinfra.dataset import simulation

AnyLidar: TypeAlias = "simulation.Lidar | str | os.PathLike[str]"
AnyFrames: TypeAlias = (
    "FrameSequence | LidarFrame | npt.ArrayLike | Sequence[npt.ArrayLike] | str | os.PathLike[str]"
)
AnyLidars: TypeAlias = "list[AnyLidar] | tuple[AnyLidar, ...]"


@public(seed=(0, 2**64 - 1))
def load_scene(
    scene: str | os.PathLike[str] | Mapping[str, object],
    *,
    preset: Preset = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
    meshes: Sequence[tuple[str, npt.ArrayLike, npt.ArrayLike]] = (),
) -> simulation.World:
    """Loads a scene and builds its meshes. Traffic is simulated up to the last frame requested.

    Parameters
    ----------
    scene : name of a shipped scene (`highway`, `crossroad`, ...), a file, or a dict of the keys of
        a scene file, in which paths are relative to the working folder
    preset : `paper`, `equal` or `datasheet`; a scene may have keys that apply to one preset only
    seed : seed of traffic and noise; by default that of the scene
    set : overrides of keys, such as `{"traffic.vehicles_per_km_lane": 20}`
    mount : name of the mount; only needed if the scene has several
    meshes : objects of your own that do not move: material (`structure`, `vegetation`, ...),
        vertices (n, 3) in the world frame, metres, and faces (m, 3), indices of vertices

    Returns
    -------
    The scene, an input of `simulate`; its attribute `frames` is the number of frames of 0.1 s, and
    `frames_of(period_s)` that of frames of another period

    Raises
    ------
    Error : for an unknown name, or a wrong key or value; the message names file, line and key

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_scene("highway", seed=1, set={"duration_s": 2}).frames
    20
    """
    from pyinfra.dataset import simulation

    if isinstance(scene, Mapping):
        more = {} if seed is None else {"seed": seed}
        keys = plain(with_overrides(scene, {**(set or {}), **more}))
        if meshes:
            keys["meshes"] = [*(keys.get("meshes") or []), *_mesh_files(meshes)]  # type: ignore[misc]
        return simulation.make_world(keys, preset=preset, mount=mount)
    file = file_or_name(scene, shipped("scenes"), "scene")
    if meshes:
        set = {**(set or {}), "meshes": with_meshes(file, meshes)}
    try:
        return simulation.load_scene(file, preset=preset, seed=seed, set=set, mount=mount)
    except ConfigError as error:  # the message names options of infrasim, not arguments
        raise ConfigError(re.sub(r"--(set|mount|preset|seed)\b", r"\1", str(error))) from None


@public()
def load_lidar(
    lidar: str | os.PathLike[str] | Mapping[str, object],
    *,
    preset: Preset = "datasheet",
    rate_hz: float | None = None,
    law_exponent: float | None = None,
    echo: str | None = None,
) -> simulation.Lidar:
    """Loads a LiDAR under one preset.

    Parameters
    ----------
    lidar : name of a shipped LiDAR (`list_lidars` returns them), a file, or a dict of the keys of a
        LiDAR file, in which paths are relative to the working folder or to the shipped LiDARs
    preset : `paper`, `equal` or `datasheet`
    rate_hz : frames per second, 5 to 20; by default that of the file. The firing cycle of a
        spinning LiDAR stays the same, so that the number of columns per turn changes.
    law_exponent : power of the reflectance with which the range grows in full sun, 0.25 to 0.5, for
        a LiDAR with one published range; by default, that of the file. It has no effect on a LiDAR
        whose published ranges determine the exponent.
    echo : echoes of a ray that become points: `strongest`, `first`, `last`, or `dual` for the
        strongest and the last. By default that of the file, which also lists what the LiDAR offers.

    Returns
    -------
    The LiDAR, an input of `simulate`

    Raises
    ------
    Error : for an unknown name or preset, or for a wrong key, value or rate

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_lidar("ruby_plus").name
    'ruby_plus'
    >>> pi.load_lidar("ruby_plus", rate_hz=20).period_s
    0.05
    >>> frames = pi.simulate("crossroad", pi.load_lidar("ruby_plus", echo="dual"), range(1))
    >>> bool((frames[0].fields["echo"] == 1).any())  # second points of rays
    True
    """
    from pyinfra.dataset import simulation

    if isinstance(lidar, Mapping):
        file = file_of_keys(lidar)
    else:
        file = file_or_name(lidar, shipped("lidars"), "lidar")
    return simulation.load_lidar(
        file, preset, rate_hz=rate_hz, law_exponent=law_exponent, echo=echo
    )


@public()
def load_dataset(folder: str | os.PathLike[str]) -> RecordedFrames | dict[str, RecordedFrames]:
    """Opens the frames of a LiDAR's folder, or of each LiDAR of a data set, on disk.

    Parameters
    ----------
    folder : output of `infrasim run` or `pyinfra import`, or a folder in the KITTI layout

    Returns
    -------
    For a LiDAR's folder, a sequence of frames. For a data set, a dict that maps LiDAR names to
    sequences.

    Raises
    ------
    Error : if the folder does not exist or has no frame

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     recording = pi.export(frames, "pcd", f"{folder}/recording")
    ...     _ = pi.import_recording(recording, "pcd", f"{folder}/highway/pole")
    ...     {name: len(one) for name, one in pi.load_dataset(f"{folder}/highway").items()}
    {'pole': 3}
    """
    return _loaded(folder, "folder")


def with_overrides(
    keys: Mapping[str, object], overrides: Mapping[str, object]
) -> dict[str, object]:
    """Returns keys with overrides such as `{"traffic.vehicles_per_km_lane": 20}`."""
    out = dict(keys)
    for name, value in overrides.items():
        first, _, rest = name.partition(".")
        inner = out.get(first)
        below = inner if isinstance(inner, Mapping) else {}
        out[first] = with_overrides(below, {rest: value}) if rest else value
    return out


def file_of_keys(keys: Mapping[str, object]) -> Path:
    """Returns a file with the keys of a LiDAR, which is removed when the process ends."""
    text = yaml.safe_dump(_with_paths(plain(keys)), sort_keys=False)
    name = f"{sha256(text.encode()).hexdigest()[:16]}.yaml"
    return own_file(name, lambda file: file.write_text(text, encoding="utf-8"))


def with_meshes(
    scene: Path, meshes: Sequence[tuple[str, npt.ArrayLike, npt.ArrayLike]]
) -> list[dict[str, object]]:
    """Returns the key `meshes` of a scene file with further meshes, as in `load_scene`."""
    others = read_keys(scene).get("meshes") or []
    own = [{**mesh, "file": str(scene.absolute().parent / mesh["file"])} for mesh in others]
    return [*own, *_mesh_files(meshes)]


def _mesh_files(
    meshes: Sequence[tuple[str, npt.ArrayLike, npt.ArrayLike]],
) -> list[dict[str, object]]:
    """Writes meshes to temporary files; returns the values of the key `meshes`. Raises Error."""
    values: list[dict[str, object]] = []
    for material, vertices, faces in meshes:
        mesh = Triangles(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))
        for name, array in (("vertices", mesh.vertices), ("faces", mesh.faces)):
            if array.ndim != 2 or array.shape[1] != 3:
                raise Error(f"meshes: expected {name} (n, 3), got {array.shape}")
        digest = sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()[:16]
        file = own_file(f"{digest}.ply", partial(write_ply, mesh=mesh))
        values.append({"file": str(file), "material": material})
    return values


def _with_paths(value: Any, key: str = "") -> Any:
    """Returns keys with an absolute path for each `file`, in the working folder or the package."""
    if isinstance(value, dict):
        return {name: _with_paths(inner, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [_with_paths(inner, key) for inner in value]
    if key != "file" or not isinstance(value, str) or not value:
        return value
    ours = configs() / "lidars" / value
    return str(Path(value).absolute() if Path(value).exists() or not ours.exists() else ours)


def plain(keys: Mapping[str, object]) -> dict[str, object]:
    """Returns keys with NumPy numbers and arrays as numbers and lists, and paths as texts."""

    def of(value: object) -> object:
        return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)

    return dict(json.loads(json.dumps(dict(keys), default=of)))


def sequence_of(frames: AnyFrames, argument: str) -> FrameSequence:
    """Returns an argument as a sequence. It is one frame, clouds, or what `one_lidar` accepts.

    Raises Error for any other value.
    """
    if isinstance(frames, LidarFrame):
        return frames.alone()
    if isinstance(frames, (FrameSequence, str, os.PathLike)):
        return one_lidar(frames, argument)
    given: Any = frames
    several = isinstance(given, (list, tuple)) and np.ndim(given[0] if given else 0) != 1
    items = list(given) if several else [given]
    clouds = [_cloud(x.points if isinstance(x, LidarFrame) else x, argument) for x in items]
    return ArrayFrames(tuple(clouds), tuple(range(len(clouds))))


def _cloud(value: object, argument: str) -> Float32Array:
    """Returns points (n, 4) of an array, tensor or list (n, 3) or (n, 4)."""
    try:
        points = np.array(on_cpu(value), dtype=np.float32)
    except (TypeError, ValueError):
        points = np.empty(0, np.float32)
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        shape = f" {points.shape}" if points.size else ""
        raise Error(
            f"{argument}: expected frames, a folder, points (n, 4), or a list of such arrays, got "
            f"{type(value).__name__}{shape}"
        )
    return points if points.shape[1] == 4 else np.pad(points, ((0, 0), (0, 1)))


def one_lidar(frames: FrameSequence | str | os.PathLike[str], argument: str) -> FrameSequence:
    """Opens a LiDAR's folder, or returns a given frame sequence.

    A data set with one LiDAR is accepted. Raises Error for several LiDARs.
    """
    if isinstance(frames, FrameSequence):
        return frames
    loaded = _loaded(frames, argument)
    if isinstance(loaded, dict):
        if len(loaded) == 1:
            return next(iter(loaded.values()))
        names = ", ".join(loaded)
        raise Error(f"{argument}: expected one LiDAR, got a data set with the LiDARs {names}")
    return loaded


def _loaded(
    folder: str | os.PathLike[str], argument: str
) -> RecordedFrames | dict[str, RecordedFrames]:
    path = path_of(folder, argument)
    check_exists(path)
    if not path.is_dir():
        raise Error(f"{argument}: expected a folder, got '{path}'")
    if lidars := lidars_in(path):
        return {lidar.name: _recorded(lidar, argument) for lidar in lidars}
    return _recorded(path, argument)


def _recorded(folder: Path, argument: str) -> RecordedFrames:
    try:
        numbers = frame_numbers(folder, "all")
    except FileNotFoundError:
        raise Error(
            f"{argument}: expected a data set or a LiDAR's folder (with training/velodyne), got "
            f"'{folder}'"
        ) from None
    if not numbers:
        raise Error(f"{argument}: expected one or more frames, got none in '{folder}'")
    return RecordedFrames(folder, tuple(numbers))
