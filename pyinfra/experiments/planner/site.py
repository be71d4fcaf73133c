"""The site of a plan: its roads, its weighted objects, and the frames that are observed."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.names import StrPath, file_or_name
from pyinfra.core.vocabulary import OBJECT_NAMES
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import shipped
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.roads import Road
from pyinfra.dataset.simulated_frames import roads_of_world
from pyinfra.scenes.maps.map_file import FORMATS, PACKED
from pyinfra.scenes.maps.network import read_network
from pyinfra.scenes.maps.site_folder import NET, check_metres, scene_of

LEAST_TO_SPLIT = 6  # minimum number of recorded frames that are divided between choice and check
NEAR_M = 80.0  # maximum distance from the mount to a map's junction that becomes the centre
PATTERN_FRAMES = 200  # number of frames after which the Livox scan patterns repeat
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(eq=False)
class SiteObserver:
    """The observer of a site. It is built when it, or a pickled copy of it, is first used."""

    build: Callable[[], simulation.Observer]

    @cached_property
    def built(self) -> simulation.Observer:
        return self.build()

    def __getstate__(self) -> dict[str, object]:
        return {"build": self.build}


@dataclass(frozen=True, eq=False)
class PlanSite:
    """A site under one preset and traffic seed, and its objects in the frames of a plan."""

    file: Path
    name: str
    preset: str
    seed: int | None
    mount: str  # the scene's mount whose evaluation region counts
    keys: dict[str, Any]  # resolved keys of the scene
    roads: tuple[Road, ...]  # the evaluation region, world frame
    every_frame: int  # number of frames of the scene
    frames: tuple[int, ...]  # frame numbers, in the order of observation
    present: pd.DataFrame  # objects in the region; columns frame, id, type, person, x, y, speed
    centre: FloatArray  # (2,) origin of the distances of the request, world frame
    observed: SiteObserver
    period_s: float = PERIOD_S  # frame period of the LiDARs

    @property
    def observer(self) -> simulation.Observer:
        return self.observed.built

    @property
    def recorded(self) -> bool:
        """Whether the vehicles follow a file of trajectories, which no seed changes."""
        return bool(self.keys.get("trajectories"))

    @property
    def has_weather(self) -> bool:
        """Whether LiDARs detect by received power, which rain and light change."""
        return self.preset == "datasheet"

    @property
    def other_seed(self) -> int:
        """The traffic seed of the predictions and measurements that follow the choice."""
        return int(self.keys["seed"]) + 1

    def is_near(self, objects: pd.DataFrame, within_m: float) -> BoolArray:
        """Returns which objects (columns x, y) are within a distance of the centre: (n,)."""
        x, y = self.centre
        return np.asarray(np.hypot(objects.x - x, objects.y - y) <= within_m)

    def other_frames(self, count: int) -> tuple[int, ...]:
        """Returns the numbers of the frames for predictions and simulations.

        For recorded traffic, these frames are later than those of the choice.
        """
        first = choice_end(self.keys, self.every_frame) % self.every_frame
        return tuple(first + k for k in frame_order(self.every_frame - first, count))


def open_site(
    scene: StrPath,
    frames: int,
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    centre_m: tuple[float, float] | None = None,
    period_s: float = PERIOD_S,
    further_seeds: int = 0,
) -> PlanSite:
    """Opens a scene, or the scene of a site folder. `period_s` is the LiDARs' frame period.

    further_seeds: number of traffic seeds after that of `seed` with which the scene is checked.
    Raises Error if the region has no traffic, and for positions in longitude and latitude.
    """
    if centre_m is not None and not np.isfinite(centre_m).all():
        raise Error(f"centre_m: expected x and y in metres, got {centre_m}")
    file = scene_path(scene)
    world = simulation.load_scene(file, preset=preset, seed=seed, mount=first_mount(file, preset))
    keys = dict(yaml.safe_load(world.dump()))
    mount = next(iter(keys["mounts"]))
    feet = np.array([[one["x_m"], one["y_m"]] for one in keys["mounts"].values()])
    check_metres(file.parent, feet, f"{file}: mounts: x_m, y_m")
    if centre_m is not None:
        check_metres(file.parent, np.array([centre_m]), "centre_m")
    own_seed = int(keys["seed"])
    seeds = min(further_seeds, 1) if keys.get("trajectories") else further_seeds
    for other in range(own_seed + 1, own_seed + 1 + seeds):
        try:
            simulation.load_scene(file, preset=preset, seed=other, mount=mount)
        except Error as error:
            raise Error(
                f"{error}; this is with the traffic seed {other}, which a plan with the seed "
                f"{own_seed} also simulates"
            ) from None
    count = world.frames_of(period_s)
    order = frame_order(choice_end(keys, count), frames)
    observed = SiteObserver(
        partial(
            simulation.load_observer, file, order, preset=preset, seed=seed, mount=mount,
            period_s=period_s,
        )
    )  # fmt: skip
    roads = tuple(roads_of_world(world, f"{file.name}: roads"))
    present = present_objects(observed.built, order)
    if present.empty:
        raise Error(
            f"scene: expected traffic in the evaluation region, got none in {len(order)} frames; "
            "`traffic`, `trajectories` or `people` of the scene file add objects"
        )
    centre = np.array(centre_m if centre_m else middle_of(keys, roads, file.parent / NET))
    return PlanSite(
        file, str(keys.get("name", file.stem)), preset, seed, mount, keys, roads, count, order,
        present, centre, observed, period_s,
    )  # fmt: skip


def other_traffic(
    site: PlanSite, count: int, scene_keys: Mapping[str, object] | None = None
) -> PlanSite:
    """Returns the site with frames other than those of the choice.

    Simulated traffic has another seed. Of recorded traffic, the last third is used. scene_keys:
    overrides of keys, as in `simulation.load_scene`.
    """
    frames, seed = site.other_frames(count), site.other_seed
    observed = SiteObserver(
        partial(
            simulation.load_observer, site.file, frames, preset=site.preset, seed=seed,
            mount=site.mount, set=scene_keys, period_s=site.period_s,
        )
    )  # fmt: skip
    return replace(
        site,
        seed=seed,
        keys=site.keys | dict(scene_keys or {}),
        frames=frames,
        present=present_objects(observed.built, frames),
        observed=observed,
    )


def choice_end(keys: dict[str, Any], count: int) -> int:
    """Returns the end of the frames of the choice: all frames, or two thirds of recorded frames."""
    return 2 * count // 3 if keys.get("trajectories") and count >= LEAST_TO_SPLIT else count


def scene_path(scene: StrPath) -> Path:
    """Returns the scene file of a name, a file, or a folder of `pyinfra site import`."""
    folder = Path(scene)
    if folder.is_dir():
        return scene_of(folder)
    if folder.name.lower().endswith((*FORMATS, *PACKED)):
        raise Error(
            f"scene: expected a scene file or the folder of a site, got the map '{scene}'; "
            "`pyinfra site import` makes a site of it"
        )
    return file_or_name(scene, shipped("scenes"), "scene")


def first_mount(file: Path, preset: str) -> str:
    """Returns the name of the scene's first mount; empty if the file does not name it."""
    keys = yaml.safe_load(file.read_text(encoding="utf-8-sig"))
    mounts = keys.get("mounts") if isinstance(keys, dict) else None
    return str(next(iter(mounts))) if isinstance(mounts, dict) and mounts else ""


def frame_order(count: int, wanted: int) -> tuple[int, ...]:
    """Returns frames in an order in which each part of the list is spread over the whole scene.

    The step is coprime to the number of frames and to PATTERN_FRAMES, so that the frames show
    every phase of a scan pattern.
    """
    step = max(1, round(count * GOLDEN))
    while math.gcd(step, count) > 1 or math.gcd(step, PATTERN_FRAMES) > 1:
        step += 1
    return tuple((i * step + count // 2) % count for i in range(min(wanted, count)))


def present_objects(observer: simulation.Observer, frames: Sequence[int]) -> pd.DataFrame:
    """Returns every vehicle and pedestrian in the region, ordered as `frames`, then by id.

    Positions are in the world frame. Cyclists are left out, because their recall is too low to be
    predicted.
    """
    rows = observer.present(list(frames))
    table = pd.DataFrame({name: rows[name] for name in ("frame", "id", "x", "y", "speed")})
    table["type"] = [OBJECT_NAMES[int(c)] for c in rows["class_id"]]
    table = table[table.type != "Cyclist"].reset_index(drop=True)
    table["person"] = table.type == "Pedestrian"
    return table


def middle_of(keys: dict[str, Any], roads: tuple[Road, ...], net: Path) -> FloatArray:
    """Returns the middle of the first junction of a scene, x and y in the world frame.

    For an imported map, the junction within NEAR_M of the first mount with the most connections is
    used. Without a junction, the result is the road point nearest to the mount.
    """
    mount = next(iter(keys["mounts"].values()))
    foot = np.array([mount["x_m"], mount["y_m"]])
    for junction in [one for one in keys.get("junctions") or [] if one.get("roads")][:1]:
        if (middle := junction_middle(junction, roads)) is not None:
            return middle
    junctions = read_network(net, lanes=False).junctions if net.is_file() else []
    near = [(n, -math.dist(at, foot), *at) for n, *at in junctions if math.dist(at, foot) < NEAR_M]
    if near:
        return np.array(max(near)[2:])
    every = np.concatenate([road.xy for road in roads])
    return np.asarray(every[np.hypot(*(every - foot).T).argmin()])


def junction_middle(junction: Mapping[str, Any], roads: Sequence[Road]) -> FloatArray | None:
    """Returns the middle of a junction of two roads; None if a road is not in the region."""
    lines = {road.name: road.xy for road in roads}
    names = junction.get("roads") or []
    if len(names) < 2 or not all(name in lines for name in names):
        return None
    a, b = (lines[name] for name in names[:2])
    away = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    i, j = np.unravel_index(away.argmin(), away.shape)
    return np.asarray((a[i] + b[j]) / 2)
