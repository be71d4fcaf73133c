"""Public API functions that import maps and recordings, and export frames and tracks."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error, FindingWarning, FormatError
from pyinfra.core.names import StrPath, check_name, path_of
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.health import HEALTH_PICTURE
from pyinfra.dataset.loading import one_lidar
from pyinfra.dataset.object_rows import BOX
from pyinfra.exchange import track_files
from pyinfra.formats.csv_table import read_words
from pyinfra.formats.kitti.lidar import PERIOD_S
from pyinfra.tracking.table_file import TRACK_COLUMNS, write_tracks

if TYPE_CHECKING:
    from pyinfra.exchange.imported import ImportedFrames
    from pyinfra.exchange.recording import Boxes

TRACK_FILES = {".csv": "tracks.csv"} | track_files.FORMATS  # names of formats by extension


@public(radius_m=(10, 100_000), vehicles_per_hour=(0, math.inf), seed=(0, 2**31 - 1))
def import_map(
    file: StrPath,
    out: StrPath,
    *,
    centre: tuple[float, float] | None = None,
    radius_m: float = 1000.0,
    mount: tuple[float, float, float, float] | None = None,
    traffic_side: Literal["left", "right"] | None = None,
    vehicles_per_hour: float = 1000.0,
    seconds: float = 500.0,
    seed: int = 1,
) -> Path:
    """Makes a site folder from an OpenDRIVE map, an OpenStreetMap file or a SUMO network.

    SUMO then simulates the traffic of the site, unless the folder already has this traffic, or
    recorded trajectories.

    Parameters
    ----------
    file : map file (.xodr, .osm or .net.xml), which may be compressed with gzip or bzip2
    out : folder of the site; an existing result of the same import is not written again
    centre : x, y in the map's frame (OpenStreetMap: longitude, latitude); default: the map's middle
    radius_m : radius around the centre within which the map is imported
    mount : x, y, z, yaw_deg of the pole in the site's frame; by default a position is estimated
    traffic_side : `left` or `right` for OpenStreetMap; default: as in its roundabouts, else right
    vehicles_per_hour : traffic volume; 0 writes no trajectories, but `load_scene` needs some
    seconds : duration of the traffic, 1 to 3600
    seed : seed of the traffic simulation

    Returns
    -------
    Path of the site's scene file, an input of `load_scene`

    Raises
    ------
    Error : for a map that cannot be read; the message names the file and, if known, the line. Also
        for a folder with other traffic

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pyinfra as pi
    >>> road = '''<osm version="0.6">
    ... <node id="1" lon="11.0" lat="48.0"/> <node id="2" lon="11.006" lat="48.0"/>
    ... <way id="3"> <nd ref="1"/> <nd ref="2"/> <tag k="highway" v="primary"/> </way>
    ... </osm>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     map = Path(folder) / "road.osm"
    ...     _ = map.write_text(road)
    ...     site = pi.import_map(map, f"{folder}/road", seconds=10)
    ...     pi.load_scene(site).frames
    100
    """
    from pyinfra.scenes.maps.map_import import import_map as run
    from pyinfra.scenes.maps.map_readers import ImportOptions
    from pyinfra.scenes.maps.site_traffic import has_traffic, write_traffic
    from pyinfra.scenes.maps.traffic_demand import Demand

    folder = path_of(out, "out")
    options = ImportOptions(
        centre=centre, radius_m=radius_m, mount=mount, traffic_side=traffic_side
    )
    run(path_of(file, "file"), folder, options)
    demand = Demand(vehicles_per_hour)
    if vehicles_per_hour and not has_traffic(folder, demand, seconds, seed):
        write_traffic(folder, demand, seconds, seed)
    return folder / "site.yaml"


@public(period_s=PERIOD_S, tilt_deg=(-90, 90), columns=(3, 64), unit_m=(1e-6, 1000))
def import_recording(
    source: StrPath,
    format: str | None,
    out: StrPath,
    *,
    scene: str | None = None,
    model: str | None = None,
    price_usd: tuple[float, float] | None = None,
    period_s: float | None = None,
    height_m: float | None = None,
    tilt_deg: tuple[float, float] | None = None,
    upright: Literal["auto", "road", "as-is"] = "auto",
    region: StrPath | None = None,
    types: Mapping[str, str] | None = None,
    labels: StrPath | None = None,
    label_columns: Mapping[str, str] | None = None,
    intensity_max: float | None = None,
    unit_m: float = 1.0,
    columns: int | None = None,
    channel: str | None = None,
    strict: bool = False,
    skip_bad: bool = False,
) -> ImportedFrames:
    """Converts a recording of another tool to the folder of one LiDAR.

    All assumptions about the recording are written to the folder's lidar.yaml. The function warns
    of frames without labels, of vehicles wider than long, and of what it left out or changed.

    Parameters
    ----------
    source : folder or file of the recording, or `sample` for the recording of the package
    format : kitti, openpcdet, pcd, nuscenes, bag, pcap, las, ply, csv, bin, dair-v2x, tumtraf or
        rcooper; None guesses it from the names of the files
    out : new folder, named DATA/LIDAR: a data set's folder, which is new, empty or has a
        dataset.yaml, and a LiDAR's name; for a single name DATA, the LiDAR's name is `lidar`
    scene : name of the site; by default that of the folder DATA
    model : model of the LiDAR; by default the name of its folder
    price_usd : lowest and highest price of the LiDAR in US dollars
    period_s : time from one frame number to the next in seconds; by default taken from the
        recording, or 0.1 if it has none
    height_m : height of the sensor above the road; by default estimated from the points
    tilt_deg : pitch (positive looks down) and roll of the sensor; points and boxes are levelled
    upright : how points are levelled: `road` by a plane that is fitted to the road, `as-is` not at
        all, `auto` as `road` unless the points should be level by their format or their labels
    region : YAML file with the outline of the area where vehicles can be, which is copied to `out`
    types : maps class names of the recording to types (Car, Van, Truck, ...)
    labels : folder of the labels, or a .csv file with a column of frames; default: by the format
    label_columns : maps keys (frame, class, x, y, z or z_bottom, length, width, height, yaw or
        yaw_deg, id) to the columns of .csv labels; plain names are recognised
    intensity_max : largest intensity of the source; by default detected: 1, 255, 4095 or 65535
    unit_m : length unit of the source's coordinates in metres
    columns : number of float32 values per point in a .bin file; by default detected
    channel : name or topic of the LiDAR, if the recording has several
    strict : whether objects that cannot be read raise Error; by default they are left out
    skip_bad : whether to leave out frames that cannot be read; by default they raise Error

    Returns
    -------
    The frames, as `load_dataset` returns them; their attribute `folder` is the LiDAR's folder, and
    `assumed` lists the assumptions, `not_read` files of the recording that were not read

    Raises
    ------
    Error : for an unknown format, a number out of range, or a recording that cannot be read

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     recording = pi.export(frames, "pcd", f"{folder}/recording")
    ...     recorded = pi.import_recording(recording, "pcd", f"{folder}/highway/pole")
    ...     len(recorded), recorded[0].points.shape[1]
    (3, 4)
    """
    from pyinfra.exchange import imports
    from pyinfra.exchange.formats import IMPORTS
    from pyinfra.exchange.guess import guess_format
    from pyinfra.exchange.imported import ImportedFrames
    from pyinfra.exchange.recording import Options

    folder = imports.output_folder(path_of(out, "out"))
    recording = imports.recording_folder(path_of(source, "source"))
    if format is None:  # every format raises an error if the source is missing
        format = guess_format(recording)[0] if recording.exists() else "pcd"
    check_name(format, IMPORTS, "format")
    facts = imports.facts_of(
        folder,
        scene=scene,
        model=model,
        price_usd=price_usd,
        period_s=period_s,
        height_m=height_m,
        tilt_deg=tilt_deg,
        types=types,
    )
    of_labels = None if labels is None else path_of(labels, "labels")
    named = dict(label_columns or {})
    options = Options(intensity_max, columns, of_labels, channel, unit_m, named)
    summary, labelled = imports.import_recording(
        recording,
        format,
        folder,
        facts,
        imports.checked(options),
        upright=upright,
        region=None if region is None else path_of(region, "region"),
        strict=strict,
        skip_bad=skip_bad,
    )
    for text in imports.warnings(summary, labelled, height_m):
        warnings.warn(f"{source}: {text}", FindingWarning, stacklevel=CALLER)
    if any(row.problems for row in summary.health):
        from pyinfra.viz.health_plot import draw_health  # deferred, because it loads Matplotlib

        draw_health(summary.health, folder / HEALTH_PICTURE)
    numbers = tuple(frame_numbers(folder, "all"))
    return ImportedFrames(folder, numbers, summary.assumed, tuple(summary.not_read), summary.types)


@public()
def export(frames: FrameSequence | StrPath, format: str, out: StrPath) -> Path:
    """Writes frames of one LiDAR in the format of another tool.

    Parameters
    ----------
    frames : a result of `simulate` or `load_dataset`, or a LiDAR's folder
    format : kitti (a data set, as `infrasim run` writes it), openpcdet, mmdet3d, pcd, mcap,
        nuscenes or openlabel; `docs/formats.md` lists what each format keeps
    out : new or empty folder; simulated frames are temporarily written to its parent folder

    Returns
    -------
    Path of the output folder

    Raises
    ------
    Error : for an unknown format, frames of several LiDARs, or frames that the format cannot hold

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 50, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     out = pi.export(frames, "openpcdet", f"{folder}/openpcdet")
    ...     sorted(path.name for path in out.iterdir() if path.is_dir())
    ['ImageSets', 'cfgs', 'labels', 'points']
    """
    from pyinfra.dataset.sequence_folder import on_disk
    from pyinfra.exchange import exports
    from pyinfra.exchange.formats import EXPORTS

    check_name(format, EXPORTS, "format")
    sequence, folder = one_lidar(frames, "frames"), path_of(out, "out")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with on_disk(sequence, folder.parent) as lidar_folder:
        exports.export(lidar_folder, sequence.numbers, format, folder)
    return folder


@public()
def export_tracks(
    tracks: pd.DataFrame,
    file: StrPath,
    *,
    lidar: str = "lidar",
    frames: FrameSequence | None = None,
) -> Path:
    """Writes tracks as a table or in the format of another tool.

    Parameters
    ----------
    tracks : table of `track`
    file : file to write; its ending is the format: .csv (tracks.csv), .jsonl (a JSON line per
        frame), .txt (KITTI tracking), .json (OpenLABEL) or .mcap (ROS 2 messages)
    lidar : name of the LiDAR, which is the coordinate frame of the boxes
    frames : the frames of the tracks, so that those without a track are written too

    Returns
    -------
    Path : the file

    Raises
    ------
    Error : for another ending, or a table without a column of `track`
    ImportError : if the packages of the extra `exchange` are missing, for .mcap

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway", seed=1), "helios_16", range(10))
    >>> tracks = pi.track(frames.labels.assign(score=0.9), frames)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = f"{folder}/tracks.json"
    ...     pi.export_tracks(tracks, file, lidar=frames.name, frames=frames).name
    'tracks.json'
    """
    path = path_of(file, "file")
    if path.suffix not in TRACK_FILES:
        ends = ", ".join(TRACK_FILES)
        raise Error(f"file: expected a file name that ends in {ends}; got '{path}'")
    if missing := [name for name in TRACK_COLUMNS if name not in tracks]:
        raise Error(f"tracks: expected the column '{missing[0]}' of `track`, got none")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".csv":
        write_tracks(path, tracks)
    else:
        times = {n: (n + 0.5) * frames.period_s for n in frames.numbers} if frames else {}
        track_files.write_other_format(path, tracks, lidar, times)
    return path


def nuscenes_results(file: Path, source: Path) -> dict[int, Boxes]:
    """Reads results of nuScenes with the types of this package, by frame in the order of time."""
    from pyinfra.exchange.nuscenes_tables import read_results
    from pyinfra.exchange.object_types import types_of

    found = read_results(file, source)
    return {k: replace(boxes, names=types_of(boxes.names, {})) for k, boxes in found.items()}


def csv_detections(file: Path, lidar_folder: Path, columns: Mapping[str, str]) -> pd.DataFrame:
    """Reads boxes of a .csv file as a table like that of `detect`, in the order of the file.

    The column `frame` has numbers of frames, or names of the recording's clouds (sources.csv). A
    name with an ending is always that of a cloud. Raises FormatError for a number of two frames.
    """
    from pyinfra.exchange.object_types import types_of
    from pyinfra.formats.box_csv import read_box_csv, rows_of_frames

    table, numbers = read_box_csv(file, columns), frame_numbers(lidar_folder, "all")
    names = [(f"{number:06d}", number) for number in numbers]
    if (sources := lidar_folder / "sources.csv").is_file():
        names += [(row.source, int(row.frame)) for row in read_words(sources).itertuples()]
    out = pd.DataFrame(dict(zip(BOX, table.boxes.T, strict=True)))
    out["type"] = types_of(table.names, {}).astype(object)
    out["score"] = 1.0 if table.scores is None else table.scores
    out["frame"] = -1
    for frame, rows in rows_of_frames(file, table, names).items():
        out.loc[rows, "frame"] = frame
    bad = np.flatnonzero(~out["score"].between(0, 1))
    if len(bad) > 0:
        at = f"{file}:{table.lines[int(bad[0])]}: {table.columns['score']}"
        raise FormatError(f"{at}: expected 0 to 1, got {out['score'][bad[0]]:g}")
    return out
