"""Changes of the scene and of the LiDAR of a simulation.

The test frames are simulated again with changed keys. The new frames are stored in a cache.
"""

import hashlib
import itertools
import math
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import held, resolved, write
from pyinfra.dataset import simulation, split
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import frame_numbers, lidar_folder, period_of
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.experiments.stress import lidar
from pyinfra.formats import kitti

# Keys in dataset.yaml that a run adds to the keys of the scene.
NOT_OF_THE_SCENE = ("surfaces", "preset", "version", "frames_version")
PHASES = 16  # number of random cut angles; a bundle with more spinning units repeats them
SCENE = "scene.yaml"


@dataclass(frozen=True, eq=False)
class Base:
    """The test frames of one LiDAR, without stress."""

    folder: Path
    lidar: kitti.Lidar
    scene: dict[str, Any]  # keys that the run resolved, with absolute paths; empty if unknown
    frames: tuple[int, ...]  # frame numbers, ascending

    @property
    def scene_name(self) -> str:
        return str(self.scene.get("name", "unknown"))

    @property
    def trajectories(self) -> Path | None:
        """The file of recorded trajectories; None if vehicles are simulated."""
        file = self.scene.get("trajectories")
        return Path(file) if file else None

    @property
    def mounts(self) -> dict[str, dict[str, Any]]:
        """The mounts by name: several for a fused data set, empty if they are unknown."""
        return dict(self.scene.get("mounts", {}))

    @cached_property
    def identity(self) -> str:
        """A text that identifies the frames: scene and LiDAR, with the key names of version 0.3."""
        lidar_yaml = self.folder / lidar.FILE
        try:
            keys = yaml.safe_load(
                infrasim("check", self.folder.parent / "dataset.yaml", "--canonical")
            )
            text = infrasim("check", lidar_yaml, "--canonical")
        except SimulatorError:  # the data are a recording, or simulated files that were changed
            return f"{self.scene}\n{lidar_yaml.read_text('utf-8')}"
        return f"{_scene(keys, self.folder)}\n{text}\nframes_version: {keys['frames_version']}"

    @property
    def is_fused(self) -> bool:
        return len(self.mounts) > 1

    @property
    def lidar_file(self) -> Path:
        """The file with the LiDAR's scan pattern; for fused frames, the file of the first mount."""
        if not self.is_fused:
            return self.folder / lidar.FILE
        return self.folder.parents[1] / next(iter(self.mounts)) / self.folder.name / lidar.FILE


@dataclass(frozen=True)
class AlteredScene:
    """Differences of a simulation from the base; an empty field means no difference."""

    set: tuple[str, ...] = ()  # changed keys of the scene, as KEY=VALUE
    lidar: str = ""  # name of a LiDAR in the catalogue
    scene: str = ""  # name of a scene in the catalogue
    preset: str = ""
    turns_deg: tuple[float, ...] = ()  # angles by which the units' cut angles are turned


def read_base(folder: Path, most: int) -> Base:
    """Returns at most `most` test frames of a LiDAR's folder, evenly spread.

    Without val.txt, the test frames are the validation frames of the split by time, because
    trainings then use the other frames. If frames are too few for this split, all of them are used.

    Raises FileNotFoundError, FormatError, and Error if the folder is not a LiDAR's folder.
    """
    folder = lidar_folder(folder)
    frames: Sequence[int] = frame_numbers(folder)
    if not (folder / "ImageSets/val.txt").is_file():
        with suppress(Error):
            frames = split.by_time(frames, period_of(folder)).val
    if not frames:
        raise Error(f"{folder}: expected one or more frames of the split val, got none")
    description = folder.parent / "dataset.yaml"
    scene = _scene(kitti.read_written_keys(description), folder) if description.is_file() else {}
    step = math.ceil(len(frames) / most)
    return Base(folder, kitti.read_lidar(folder), scene, tuple(frames[::step]))


def _scene(keys: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the scene of a `dataset.yaml`, ready to be simulated again."""
    scene = {key: value for key, value in keys.items() if key not in NOT_OF_THE_SCENE}
    # The key `trajectories` is relative to the folder of the original scene file. A run copies
    # the trajectories, so the copy is used.
    if scene.get("trajectories"):
        scene["trajectories"] = str(resolved(folder.parent / "trajectories.csv"))
        _tell_from_first(scene["mounts"])
    return scene


def _tell_from_first(mounts: dict[str, dict[str, Any]]) -> None:
    """Makes clock offsets relative to the first mount, whose clock the copied trajectories use."""
    first_s = next(iter(mounts.values())).get("clock_offset_s", 0)
    for mount in mounts.values():
        late_s = mount.pop("clock_offset_s", 0) - first_s
        if late_s:
            mount["clock_offset_s"] = late_s


def density(base: Base, times: float | str) -> AlteredScene:
    value = float(times) * float(base.scene["traffic"]["vehicles_per_km_lane"])
    return AlteredScene((f"traffic.vehicles_per_km_lane={value:g}",))


def speed(base: Base, times: float | str) -> AlteredScene:
    value = float(times) * float(base.scene["traffic"]["speed"]["mean_km_h"])
    return AlteredScene((f"traffic.speed.mean_km_h={value:g}",))


def tilt(base: Base, pitch_deg: float | str) -> AlteredScene:
    """Pitches every mount downwards by a further `pitch_deg`."""
    mounts = base.mounts.items()
    down = {name: mount.get("pitch_deg", 0) + float(pitch_deg) for name, mount in mounts}
    return AlteredScene(tuple(f"mounts.{name}.pitch_deg={deg:g}" for name, deg in down.items()))


def late_clocks(mounts: Mapping[str, Mapping[str, Any]], ms: float) -> tuple[str, ...]:
    """Returns KEY=VALUE words that delay the clocks of all mounts except the first.

    The last mount's delay is `ms`; the delays grow evenly in the order of the mounts.
    """
    offsets_s = [mount.get("clock_offset_s", 0) for mount in mounts.values()]
    more_s = [ms / 1000 * i / (len(offsets_s) - 1) for i in range(len(offsets_s))]
    late = zip(mounts, offsets_s, more_s, strict=True)
    return tuple(f"mounts.{name}.clock_offset_s={a + b:.6g}" for name, a, b in late if b)


def wrong_turns(mounts: Mapping[str, Mapping[str, Any]], degrees: float) -> tuple[str, ...]:
    """Returns KEY=VALUE words that add errors to the assumed yaw of all mounts except the first.

    The errors are alternately to the left and to the right.
    """
    words = []
    for i, (name, mount) in enumerate(mounts.items()):
        given_deg = mount.get("calibration_error", {}).get("yaw_deg", 0)
        if i > 0:
            yaw_deg = given_deg + degrees * (1 if i % 2 else -1)
            words.append(f"mounts.{name}.calibration_error.yaw_deg={yaw_deg:g}")
    return tuple(words)


def phase(_: Base, sample: float | str) -> AlteredScene:
    """Gives every unit an independent random cut angle, as after a power failure.

    sample: `sample_N`, where N seeds the angles.
    """
    return AlteredScene(turns_deg=angles_deg(int(str(sample).removeprefix("sample_"))))


def angles_deg(seed: int) -> tuple[float, ...]:
    """Returns PHASES random angles in degrees, seeded with `seed`."""
    return tuple(np.random.default_rng([seed, PHASES]).uniform(0, 360, PHASES).round(3).tolist())


def other_preset(base: Base, name: float | str) -> AlteredScene:
    """Uses the LiDAR of the catalogue with another preset.

    A data set has one preset only, so the LiDAR is read from the catalogue by its name.
    """
    return AlteredScene(lidar=base.lidar.name, preset=str(name))


def check(base: Base, altered: AlteredScene) -> None:
    """Checks all inputs of a changed simulation without casting rays.

    Raises Error if the scene is too short for the test frames, and the SimulatorError of the check.
    """
    with tempfile.TemporaryDirectory() as folder:
        scene, lidar_yaml = _written(_texts(base, altered), altered, Path(folder))
        infrasim("check", lidar_yaml, "--preset", _preset(base, altered))
        if altered.scene or altered.set:  # the unchanged scene was checked by the base's run
            text = infrasim("check", scene, *_sets(altered))
    if altered.scene:
        _check_length(base, scene_file(altered.scene), yaml.safe_load(text)["duration_s"])


def _check_length(base: Base, scene: Path, duration_s: float) -> None:
    needed = (base.frames[-1] + 1) * base.lidar.period_s
    if needed > duration_s + 1e-6:
        raise Error(
            f"{scene}: duration_s: expected {needed:g} or more, got {duration_s:g}; frame "
            f"{base.frames[-1]} is tested"
        )


def simulated(base: Base, altered: AlteredScene, cache: Path, name: str) -> Path:
    """Simulates the base's frames with changes; returns the LiDAR's folder in the cache.

    Existing frames are not simulated again. The folder's name is `name`, for human readers,
    followed by a digest of the configuration. Raises SimulatorError.
    """
    texts = _texts(base, altered)
    out = cache / f"{name}_{_digest(base, altered, texts)}"
    with held(cache / f"{out.name}.lock", wait=True):
        folder = out / ("fused" if base.is_fused else "") / (altered.lidar or base.lidar.name)
        if all(kitti.frame_file(folder, "velodyne", k).is_file() for k in base.frames):
            return folder
        scene, lidar_yaml = _written(texts, altered, cache / f"{out.name}_inputs")
        words = ["--preset", _preset(base, altered), "--frames", frame_words(base.frames)]
        words += ["--threads", "1", "--label-time", base.lidar.label_time, *_sets(altered)]
        words += ["--fuse"] if base.is_fused else []
        infrasim("run", scene, "--lidar", lidar_yaml, "--out", out, *words)
    return folder


def _texts(base: Base, altered: AlteredScene) -> dict[str, str]:
    """Returns the texts of the scene's and LiDAR's files by file name.

    The text of a LiDAR of the catalogue is not included, as its file exists already.
    """
    text = yaml.safe_dump(base.scene, sort_keys=False)
    if altered.scene:
        text = scene_file(altered.scene).read_text("utf-8-sig")
    if altered.lidar:
        return {SCENE: text}
    return {SCENE: text, lidar.FILE: lidar.text(base.lidar_file, altered.turns_deg)}


def _written(texts: dict[str, str], altered: AlteredScene, folder: Path) -> tuple[Path, Path]:
    """Writes the texts to a folder; returns the files of the scene and of the LiDAR."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write(folder / name, text)
    return folder / SCENE, lidar_file(altered.lidar) if altered.lidar else folder / lidar.FILE


def _digest(base: Base, altered: AlteredScene, texts: dict[str, str]) -> str:
    """Returns a digest of a changed simulation's inputs.

    The digest leaves out the numbers of the frames. Raises SimulatorError.
    """
    preset = _preset(base, altered)
    parts = [*texts.values(), preset, base.lidar.label_time, *altered.set]
    parts.append(f"frames_version {simulation.frames_version()}")
    if altered.lidar:
        parts.append(infrasim("check", lidar_file(altered.lidar), "--preset", preset))
    digest = hashlib.sha256("\n".join(parts).encode())
    if base.trajectories and not altered.scene:
        digest.update(base.trajectories.read_bytes())
    return digest.hexdigest()[:8]


def _preset(base: Base, altered: AlteredScene) -> str:
    return altered.preset or base.lidar.preset


def _sets(altered: AlteredScene) -> list[str]:
    return ["--set", *altered.set] if altered.set else []


def frame_words(frames: Sequence[int]) -> str:
    """Returns the range A:B:STEP that includes all frames, given in ascending order.

    If the frames are not evenly spaced, the range includes further frames.
    """
    gaps = [b - a for a, b in itertools.pairwise(frames)]
    return f"{frames[0]}:{frames[-1] + 1}:{math.gcd(*gaps) or 1}"
