"""Public API functions that draw frames and results, and write pages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from pyinfra.core.files import regular_files_only
from pyinfra.core.names import StrPath, path_of
from pyinfra.core.public import public
from pyinfra.core.vocabulary import Tier
from pyinfra.folders import AnyData, folders_of

SECTIONS = "pyinfra.viz.report.contents"


@public(max_points=(1, math.inf))
def view(
    data: AnyData,
    out: StrPath,
    *,
    lidars: Sequence[str] | None = None,
    frames: str | int | Sequence[int] | None = None,
    predictions: StrPath | Mapping[str, StrPath] | None = None,
    max_points: int | None = None,
) -> Path:
    """Writes an interactive 3-D view of frames as one HTML file, or a recording for Rerun.

    Parameters
    ----------
    data : frames, a data set, a LiDAR's folder, or several folders
    out : .html file, or a .rrd file for Rerun (extra `rerun`)
    lidars : names of the LiDARs to show; by default all
    frames : frame numbers, or a text `A:B` or `A:B:STEP`; by default the first frame, or the first
        one with predictions
    predictions : folder of predictions, or a tracks.csv; for several LiDARs a dict by LiDAR
    max_points : largest number of points of a frame; larger frames are thinned

    Returns
    -------
    Path of the file

    Raises
    ------
    Error : for unknown LiDARs or frames, and for a page that would be too large

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = pi.view(frames, f"{folder}/view.html", frames=[0, 10])
    ...     page.stat().st_size > 100_000
    True
    """
    from pyinfra.viz.viewer.views import write_view

    named = predictions if isinstance(predictions, Mapping) else {}
    words = [f"{name}={path_of(folder, 'predictions')}" for name, folder in named.items()]
    if predictions is not None and not isinstance(predictions, Mapping):
        words = [str(path_of(predictions, "predictions"))]
    wanted = [frames] if isinstance(frames, int) else frames
    with folders_of(data, of_lidar=True) as folders, regular_files_only(map(Path, named.values())):
        write_view(folders, path_of(out, "out"), lidars, wanted, words, max_points)
    return path_of(out, "out")


@public(frame=(0, math.inf))
def pictures(data: AnyData, out: StrPath, *, frame: int | None = None) -> list[Path]:
    """Draws one frame of data sets from above, the plan of each scene, and close-ups of vehicles.

    Parameters
    ----------
    data : frames, or the folder of a data set, or several folders
    out : folder for the pictures
    frame : number of the frame; by default the first

    Returns
    -------
    Paths of the pictures

    Raises
    ------
    Error : for a frame that a data set does not have

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = pi.pictures(frames, folder)
    >>> {file.suffix for file in files}
    {'.png'}
    """
    from pyinfra.viz.frame_pictures import draw_pictures

    with folders_of(data) as folders:
        return draw_pictures(folders, frame, path_of(out, "out"))


@public()
def report(
    results: StrPath,
    out: StrPath,
    *,
    data: Sequence[StrPath] = (),
    runs: Sequence[StrPath] = (),
    tier: Tier | None = None,
    budget_usd: float | None = None,
    min_ap: float | None = None,
    range_m: float | None = None,
    latency_ms: float | None = None,
    sections: str = SECTIONS,
) -> Path:
    """Writes the results of a benchmark, or a plan, as one HTML page that opens from disk.

    Parameters
    ----------
    results : folder of a benchmark's tables, or of a plan, which has none of the other arguments
    out : .html file
    data : data sets whose frames are shown
    runs : folders of trained detectors whose predictions are shown
    tier : tier of the benchmark; by default the most complete
    budget_usd, min_ap, range_m, latency_ms : requirements of the recommendation, as in `recommend`
    sections : name of the Python module whose list SECTIONS writes the sections

    Returns
    -------
    Path of the page

    Raises
    ------
    Error : for a folder without results, and a number out of range

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pi.benchmark("example", f"{folder}/out", work=f"{folder}/work", tier="smoke")
    ...     pi.report(f"{folder}/out", f"{folder}/report.html").name
    'report.html'
    """
    from pyinfra.viz.report.write import write_report

    numbers = {"budget_usd": budget_usd, "min_ap": min_ap, "range_m": range_m}
    return write_report(
        path_of(results, "results"),
        path_of(out, "out"),
        [path_of(one, "data") for one in data],
        [path_of(one, "runs") for one in runs],
        tier,
        sections,
        {**numbers, "latency_ms": latency_ms},
    )
