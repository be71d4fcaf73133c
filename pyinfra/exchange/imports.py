"""Imports a recording of another tool as a LiDAR's folder."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pyinfra.core.errors import Error
from pyinfra.core.files import held, new_folder, resolved, write
from pyinfra.core.vocabulary import OTHER_TYPES, VEHICLE_TYPES
from pyinfra.dataset.ground import check_height
from pyinfra.dataset.health import health_text
from pyinfra.dataset.regions import REGION_FILE, outline_region
from pyinfra.exchange.data_set import (
    HEIGHT_OFF_M,
    LidarFacts,
    write_description,
    write_lidar,
)
from pyinfra.exchange.formats import FORMATS, reader
from pyinfra.exchange.frame_times import timed
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.import_summary import ImportSummary
from pyinfra.exchange.object_types import with_public_types
from pyinfra.exchange.pose_estimation import check_region, survey, turned
from pyinfra.exchange.rates import Shown
from pyinfra.exchange.recording import Options
from pyinfra.exchange.unread import has_labels, unread_files

# How points are levelled. `road` levels the points to the estimated road, and `as-is` leaves them
# unchanged. `auto` selects `as-is` for points that are level by their format or labels.
Upright = Literal["auto", "road", "as-is"]
SAMPLE = Path(__file__).with_name("sample")  # made by tests/python/sample_recording.py
NAME = "lidar"  # name of the LiDAR if the user gives only the folder of the data set


def recording_folder(source: Path) -> Path:
    """Returns the folder of a recording that the user named.

    The name `sample` means the sample recording in the package, unless such a file exists.
    """
    return SAMPLE if str(source) == SAMPLE.name and not source.exists() else source


def import_recording(
    source: Path,
    name: str,
    out: Path,
    given: LidarFacts,
    options: Options,
    *,
    upright: Upright = "auto",
    region: Path | None = None,
    strict: bool = False,
    skip_bad: bool = False,
) -> tuple[ImportSummary, bool]:
    """Writes a recording in a format of IMPORTS to the new folder DATA/LIDAR.

    With `upright` = `auto`, the road is estimated unless the points are assumed to be level. Points
    are assumed to be level if `Format.level` is true, or if `Format.level` is None and the
    recording has labels.
    `region` is a file with an outline in the levelled frame, which is copied to the folder.
    `strict` and `skip_bad` are those of `write_lidar`.
    Returns a summary, and whether the recording has labels. Raises the errors of the format and of
    `survey`, and FileExistsError if the folder exists. The new folder is removed if an error
    occurs.
    """
    read, format = reader(name), FORMATS[name]
    check_data_folder(out)
    if source.is_file() and (kind := guess_format(source)[0]) != name:
        raise Error(f"{source}: expected a recording of the format {name}, got {kind}")
    if options.intensity_max is None:
        options = replace(options, intensity_max=format.intensity_max)
    recording = read(source, options)
    level = recording.labelled if format.level is None else format.level
    road = upright == "road" or (upright == "auto" and not level)
    estimate = survey(source, read, options, given, road=road and recording.tilt is None)
    recording, time_notes = timed(read(source, estimate.options), given.period_s)
    recording = turned(recording, estimate)
    inside = outline_region(region) if region else None
    if region and inside:
        check_region(region, inside, recording, estimate)
    types = with_public_types(name, given.types)
    facts = replace(
        estimate.facts,
        types=types,
        assumed=(*recording.notes(), *estimate.assumed, *time_notes),
        not_read=tuple(unread_files(source, recording.reads)),
    )
    lock = ExitStack()  # released after the new folder has its final name
    with lock, new_folder(out) as beside:
        shown = Shown(range(len(recording.names)))
        summary = write_lidar(recording, beside, facts, shown, strict=strict, skip_bad=skip_bad)
        if region:
            write(beside / REGION_FILE, region.read_bytes())
        tracked = summary.tracked > 0
        lock.enter_context(held(out.parent, wait=True))
        write_description(out.parent, given.scene, recording.tracks_sha256, tracked=tracked)
    return summary, recording.labelled


def warnings(summary: ImportSummary, labelled: bool, height_m: float | None = None) -> list[str]:
    """Returns warnings about the imported frames. height_m: sensor height that the user set."""
    out = []
    if not labelled:
        out.append(
            "the frames have no labels: vehicle statistics, evaluation and training of networks "
            "require labels"
        )
        if has_labels(summary.not_read):
            found = next(text for text in summary.not_read if has_labels([text]))
            out.append(f"{found} may be labels, which are not read; `labels` names them")
    elif not set(summary.types) & set(VEHICLE_TYPES):
        names = ", ".join(summary.types) or "none"
        out.append(
            f"no vehicle among the classes {names}; `types` (NAME=Car) maps a class to a vehicle"
        )
    elif unknown := sorted(set(summary.types) - set(VEHICLE_TYPES) - set(OTHER_TYPES)):
        names = ", ".join(f"{name} ({summary.types[name]})" for name in unknown)
        out.append(
            f"unknown classes, which do not count as vehicles: {names}; `types` (NAME=TYPE) maps "
            "them"
        )
    vehicles = sum(summary.types[name] for name in VEHICLE_TYPES)
    outcome = "kept because of their labels" if labelled else "left out"
    health = health_text(summary.health)
    texts: list[tuple[object, str]] = [
        (
            summary.wide > vehicles / 2,
            f"{summary.wide} of {vehicles} labelled vehicles are wider than long: length and width "
            "may be swapped",
        ),
        (
            summary.without_return,
            f"removed {summary.without_return} points without a return (not finite, or 0 0 0)",
        ),
        (
            summary.without_intensity,
            f"set {summary.without_intensity} intensities to 0, which were not finite",
        ),
        (summary.left_out, _unreadable(summary.left_out, "objects")),
        (summary.bad, _unreadable(summary.bad, "frames")),
        (health, health),
        (summary.empty, f"{_some(summary.empty)} without a return, written as empty frames"),
        (
            summary.doubled,
            f"{_some(summary.doubled)} with the same points as another frame: {outcome}",
        ),
    ]
    out += [text for holds, text in texts if holds]
    below = summary.below_m
    if height_m is not None and below is not None and abs(below - height_m) > HEIGHT_OFF_M:
        out.append(
            f"`height_m` is {height_m:g} m, but the bottoms of the labelled vehicles are "
            f"{below:.2f} m below the sensor"
        )
    return out


def _unreadable(items: list[str], kind: str) -> str:
    return f"left out {len(items)} {kind} that cannot be read, such as {''.join(items[:1])}"


def _some(names: list[str]) -> str:
    """Returns a text such as `3 frames (a, b, ...)`."""
    listed = ", ".join(names[:2]) + (", ..." if len(names) > 2 else "")
    return f"{len(names)} frame{'s'[: len(names) > 1]} ({listed})"


def output_folder(out: Path) -> Path:
    """Returns the LiDAR's folder for `out`: DATA/LIDAR, or DATA/lidar for a single name DATA.

    The result depends on the words of the path alone, and not on the files that exist.
    """
    names = [word for word in out.parts if word not in (out.anchor, ".", "..")]
    return out if len(names) > 1 else out / NAME


def check_data_folder(out: Path) -> None:
    """Raises Error if the folder of `out` is neither a data set nor empty.

    Hidden files are ignored, because an import that is running or was killed can leave them.
    """
    data = out.parent
    if not data.is_dir() or (data / "dataset.yaml").is_file():
        return
    names = sorted(path.name for path in data.iterdir())
    other = next((name for name in names if not name.startswith(".") and name != out.name), None)
    if other is not None:
        raise Error(
            "out: expected DATA/LIDAR, with a new folder, an empty folder or a data set as DATA, "
            f"got the folder {data} with '{other}'; use for example {out / NAME}"
        )


def facts_of(
    out: Path,
    *,
    scene: str | None = None,
    model: str | None = None,
    price_usd: Sequence[float] | None = None,
    period_s: float | None = None,
    height_m: float | None = None,
    tilt_deg: Sequence[float] | None = None,
    types: Mapping[str, str] | None = None,
) -> LidarFacts:
    """Converts a user's arguments to LidarFacts. Raises Error for an argument out of range."""
    out = resolved(out)
    if not re.fullmatch(r"[\w.-]+", out.name) or out.name.startswith("."):
        raise Error(
            f"out: expected a LiDAR name of letters, digits, '_', '.', '-', got '{out.name}'"
        )
    if price_usd is not None and not 0 <= price_usd[0] <= price_usd[1] < math.inf:
        raise Error(f"price_usd: expected 0 <= low <= high, got {price_usd}")
    if height_m is not None:
        check_height(height_m)
    return LidarFacts(
        name=out.name,
        scene=scene or out.parent.name,
        model=model,
        price_usd=(price_usd[0], price_usd[1]) if price_usd else None,
        period_s=period_s,
        height_m=height_m,
        tilt=(math.radians(tilt_deg[0]), math.radians(tilt_deg[1])) if tilt_deg else None,
        types=dict(types or {}),
    )


def checked(options: Options) -> Options:
    """Returns the options unchanged. Raises Error for a number out of range."""
    highest = options.intensity_max
    if highest is not None and not 0 < highest < math.inf:
        raise Error(f"intensity_max: expected above 0, got {highest:g}")
    return options
