"""The table of stressors: name, unit, severities and effect of each."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.core.names import check_name
from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import LIDARS, SCENES
from pyinfra.experiments.stress import altered_scenes, clouds, limits
from pyinfra.experiments.stress.altered_scenes import AlteredScene, Base
from pyinfra.models.training import sensor_faults

Severity = float | str
UNSTRESSED = "own"  # severity without stress, for stressors whose severities are names
CloudChange = Callable[[Points, float, sensor_faults.Rng], Points]
SceneChange = Callable[[Base, Severity], AlteredScene]
# A requirement of a stressor: returns why the base does not meet it, or an empty text.
Need = Callable[[Base], str]


@dataclass(frozen=True)
class Stressor:
    """One kind of stress.

    `cloud` changes point clouds, and `scene_change` changes the simulation. A stressor without
    either compares trainings of a detector.
    """

    name: str
    unit: str  # unit of the severities; `name` for severities that are names
    severities: tuple[Severity, ...]  # the first severity means no stress
    cloud: CloudChange | None = None
    scene_change: SceneChange | None = None
    needs: tuple[Need, ...] = ()
    each_frame: bool = True  # whether random numbers differ between frames

    @property
    def named(self) -> bool:
        return self.unit == "name"

    @property
    def acts_on(self) -> str:
        if self.cloud:
            return "cloud"
        return "scene" if self.scene_change else "training"

    def lacks(self, base: Base) -> str:
        """Returns why the stressor cannot be applied to a base; empty if it can."""
        return next((why for need in self.needs if (why := need(base))), "")

    def apply(self, points: Points, severity: float, seed: int, frame: int) -> Points:
        """Returns the cloud (n, 4) changed by a severity, or `points` itself for no stress."""
        assert self.cloud is not None
        if severity == self.severities[0]:
            return points
        key = (seed, zlib.crc32(self.name.encode()), *([frame] if self.each_frame else []))
        return self.cloud(points, severity, np.random.default_rng(key))

    def parse(self, words: list[str]) -> tuple[Severity, ...]:
        """Parses severities, and leaves out the severity without stress.

        Raises Error for an invalid severity, also for one below the severity without stress.
        """
        if self.named:
            unknown = [word for word in words if word not in self.severities]
            if unknown:
                allowed = ", ".join(map(str, self.severities[1:]))
                raise Error(f"severities: expected one of {allowed}; got '{unknown[0]}'")
            return tuple(word for word in words if word != UNSTRESSED)
        least = float(self.severities[0])
        return tuple(v for v in (_severity(word, least) for word in words) if v != least)


def _severity(word: str, least: float) -> float:
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not least <= value < float("inf"):
        raise Error(f"severities: expected a number, {least:g} or more, got '{word}'")
    return value


SCENE = (limits.scene, limits.rays)
TRAFFIC = (*SCENE, limits.traffic)
CUT_ANGLE = (*SCENE, limits.cut_angle)
POLES = (limits.several_mounts, *SCENE)
ALONE = (limits.one_mount,)  # points of a fused cloud have no common origin of ranges and angles
NONE = Stressor("none", "", (0.0,))
STRESSORS = {
    row.name: row
    for row in (
        Stressor("drop_out", "share", (0.0, 0.5, 0.75, 0.9, 0.97), sensor_faults.drop_out),
        Stressor("rain", "mm/h", (0.0, 10.0, 50.0, 100.0, 200.0), clouds.rain, needs=ALONE),
        Stressor("fog", "1/km", (0.0, 5.0, 10.0, 20.0, 40.0), clouds.fog, needs=ALONE),
        Stressor(
            "range_noise", "m", (0.0, 0.1, 0.2, 0.4, 0.8), sensor_faults.range_noise, needs=ALONE
        ),
        Stressor("height_error", "m", (0.0, 0.25, 0.5, 1.0, 2.0), clouds.height_error),
        Stressor(
            "roll_error", "deg", (0.0, 0.5, 1.0, 2.0, 4.0), partial(clouds.angle_error, axis="roll")
        ),
        Stressor(
            "pitch_error",
            "deg",
            (0.0, 0.25, 0.5, 1.0, 2.0),
            partial(clouds.angle_error, axis="pitch"),
        ),
        Stressor(
            "yaw_error", "deg", (0.0, 0.25, 0.5, 1.0, 2.0), partial(clouds.angle_error, axis="yaw")
        ),
        Stressor(
            "lost_lines",
            "share",
            (0.0, 0.5, 0.75, 0.9, 0.97),
            sensor_faults.lost_lines,
            needs=ALONE,
            each_frame=False,
        ),
        Stressor(
            "blocked_sector",
            "deg",
            (0.0, 10.0, 20.0, 40.0, 80.0),
            clouds.blocked_sector,
            needs=ALONE,
        ),
        # The catalogue's highway has no space for more than four times its vehicles.
        Stressor(
            "density", "times", (1.0, 2.0, 4.0), scene_change=altered_scenes.density, needs=TRAFFIC
        ),
        Stressor(
            "speed",
            "times",
            (1.0, 1.25, 1.5, 2.0),
            scene_change=altered_scenes.speed,
            needs=TRAFFIC,
        ),
        Stressor(
            "tilt",
            "deg",
            (0.0, 5.0, 10.0, 15.0, 20.0),
            scene_change=altered_scenes.tilt,
            needs=SCENE,
        ),
        Stressor(
            "cut_angle",
            "deg",
            (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0),
            # turns the cut angles of all units to the left
            scene_change=lambda _, degrees: AlteredScene(turns_deg=(float(degrees),)),
            needs=CUT_ANGLE,
        ),
        Stressor(
            "phase",
            "name",
            (UNSTRESSED, "sample_1", "sample_2", "sample_3", "sample_4"),
            scene_change=altered_scenes.phase,
            needs=CUT_ANGLE,
        ),
        Stressor(
            "unseen_lidar",
            "name",
            (UNSTRESSED, *LIDARS),
            scene_change=lambda _, name: AlteredScene(lidar=str(name)),
            needs=(limits.scene, limits.known_preset),
        ),
        Stressor(
            "unseen_scene",
            "name",
            (UNSTRESSED, *SCENES),
            scene_change=lambda _, name: AlteredScene(scene=str(name)),
            needs=(*ALONE, *SCENE),
        ),
        Stressor(
            "unseen_preset",
            "name",
            (UNSTRESSED, *PRESETS),
            scene_change=altered_scenes.other_preset,
            needs=(limits.scene, limits.catalogue),
        ),
        Stressor(
            "vehicle_class",
            "name",
            (UNSTRESSED, "Truck", "Bus", "Motorcycle"),
            scene_change=lambda _, name: AlteredScene((f"traffic.class_shares={{{name}: 1}}",)),
            needs=TRAFFIC,
        ),
        Stressor(
            "pole_clock",
            "ms",
            (0.0, 10.0, 20.0, 50.0, 100.0),
            scene_change=lambda base, ms: AlteredScene(
                altered_scenes.late_clocks(base.mounts, float(ms))
            ),
            needs=POLES,
        ),
        Stressor(
            "pole_yaw",
            "deg",
            (0.0, 0.1, 0.2, 0.5, 1.0),
            scene_change=lambda base, degrees: AlteredScene(
                altered_scenes.wrong_turns(base.mounts, float(degrees))
            ),
            needs=POLES,
        ),
        # Severities of training_frames and training_seed are the runs' training frames and seeds.
        Stressor("training_frames", "frames", ()),
        Stressor("training_seed", "name", (UNSTRESSED,)),
    )
}


def chosen(names: list[str], words: list[str] | None) -> dict[Stressor, tuple[Severity, ...]]:
    """Returns stressors by their names, with their severities except the one without stress.

    words: severities, if there is only one stressor; by default those defined for it. Raises Error.
    """
    for name in names:
        check_name(name, STRESSORS, "stressors", "names of stressors")
    selected = [STRESSORS[name] for name in dict.fromkeys(names)]
    if words is None:
        return {stressor: stressor.severities[1:] for stressor in selected}
    if len(selected) != 1 or selected[0].acts_on == "training":
        text = "severities: expected one stressor that acts on clouds or scenes, got "
        raise Error(text + (", ".join(stressor.name for stressor in selected) or "none"))
    return {selected[0]: selected[0].parse(words)}
