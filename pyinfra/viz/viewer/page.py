"""Makes the interactive view as HTML: a fragment per view, and the library once per page.

Library, style and data are in the page, so nothing is loaded from the network. The data is a JSON
script element in which every `<` is escaped. Names are shown as text and never as markup.
"""

import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.surroundings import Surroundings, pieces, road_lines
from pyinfra.formats import kitti
from pyinfra.viz.page_file import check_file, write_page_file
from pyinfra.viz.viewer.encoding import STEP_M, pack_points
from pyinfra.viz.viewer.frames import ViewFrame

Views = Mapping[str, Sequence[ViewFrame]]

DRAWN = " Lines on the ground are the road, as far as it is evaluated; brown boxes are buildings."
LARGEST_MB = 40.0  # maximum size of a page
LEAST_LETTERS = 1.3  # minimum number of characters that encode one point; 3 to 4 are usual
ADVICE = "choose fewer `frames`, one `lidar` or a lower `most_points`"
STANDING = ("buildings", "further_mounts")
LINE_STEP = 5  # every fifth point along a road is drawn
MIN_SCORE = 0.3  # minimum score of the predictions that are shown initially
_GROUND_PERCENTILE = 20  # percentile of point heights; most points of a roadside sensor are ground
# This policy blocks every request of the page, even if a name in the data contains markup.
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="generator" content="pyinfra {version}">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; }}
:root[data-theme="light"] {{ color-scheme: light; }}
:root[data-theme="dark"] {{ color-scheme: dark; }}
body {{ margin: 0; background: light-dark(#fff, #0b0f14); font-family: system-ui, sans-serif; }}
main {{
  box-sizing: border-box; min-height: 100dvh; padding: 0.75rem 1rem;
  display: flex; flex-direction: column; gap: 0.5rem;
}}
h1 {{ margin: 0; font-size: 1.125rem; line-height: 1.3; overflow-wrap: anywhere; }}
.lidar-view {{ flex: 1; }}
.lidar-view .lv-stage {{ flex: 1; min-height: 20rem; height: auto; }}
</style>
</head>
<body>
<main>
<h1>{title}</h1>
{fragment}
</main>
{library}
</body>
</html>
"""


def library() -> str:
    """Returns the style and the script. A page needs both once, after its fragments."""
    folder = files("pyinfra.viz.viewer")
    style = (folder / "viewer.css").read_text(encoding="utf-8")
    script = (folder / "viewer.min.js").read_text(encoding="utf-8")
    return f"<style>\n{style}</style>\n<script>\n{script}</script>"


def fragment(
    views: Views,
    *,
    element_id: str,
    most_points: int | None = None,
    around: Surroundings | None = None,
) -> str:
    """Returns an interactive view of the frames of some LiDARs in the same world frame.

    views: frames by display name, with the same frame numbers for each LiDAR. element_id: id of the
    figure, of letters, digits, - and _. most_points: frames with more points are thinned to this
    number, and the page has a note about it. around: roads and buildings to draw. Raises Error if
    there is no frame, or if the LiDARs have different frames.
    """
    if not re.fullmatch(r"[A-Za-z][\w-]*", element_id, re.ASCII):
        raise Error(
            f"element_id: expected a letter, then letters, digits, - or _, got '{element_id}'"
        )
    data = json.dumps(_view(views, most_points, around), separators=(",", ":"), allow_nan=False)
    safe = data.replace("<", "\\u003c")
    label = html.escape(f"Interactive 3-D view: {', '.join(views)}")
    return (
        f'<figure class="lidar-view" id="{element_id}" aria-label="{label}">\n'
        f'<script type="application/json">{safe}</script>\n'
        "<noscript>The 3-D view needs JavaScript.</noscript>\n</figure>"
    )


def page(
    views: Views,
    *,
    title: str,
    most_points: int | None = None,
    around: Surroundings | None = None,
) -> str:
    """Returns a whole page with one view. Raises the exceptions of fragment()."""
    return _PAGE.format(
        policy=_POLICY,
        version=__version__,
        title=html.escape(title),
        fragment=fragment(views, element_id="view", most_points=most_points, around=around),
        library=library(),
    )


def write_page(
    views: Views,
    title: str,
    out: Path,
    most_points: int | None = None,
    around: Surroundings | None = None,
) -> int:
    """Writes the page and returns its size in bytes.

    Raises Error before writing if the page exceeds LARGEST_MB or `out` is a folder.
    """
    check_file(out)
    text = page(views, title=title, most_points=most_points, around=around)
    return write_page_file(text, out, LARGEST_MB, ADVICE)


def check_size(
    folders: Sequence[Path], frames: Sequence[int], most_points: int | None = None
) -> None:
    """Raises Error if a page of these frames would certainly exceed LARGEST_MB.

    Only the sizes of the files are read. The length of a page is estimated from LEAST_LETTERS.
    """
    most, letters = most_points or 2**63, 0.0
    for folder in folders:
        for frame in frames:
            size = kitti.frame_file(folder, "velodyne", frame).stat().st_size
            letters += LEAST_LETTERS * min(size // 16, most)
    if letters > 1e6 * LARGEST_MB:
        raise Error(
            f"frames: expected a page of up to {LARGEST_MB:g} MB, got {len(frames)} frames of "
            f"{len(folders)} LiDARs with {letters / 1e6:.0f} MB or more; {ADVICE}"
        )


def _view(views: Views, most_points: int | None, around: Surroundings | None) -> dict[str, Any]:
    frames = _common_frames(views)
    first = next(iter(views.values()))[0]
    lidars = [
        {"name": name, "frames": [_frame(view, most_points) for view in frame_views]}
        for name, frame_views in views.items()
    ]
    return {
        "frames": [{"number": k, "start_s": round(k * first.period_s, 6)} for k in frames],
        "period_s": first.period_s,
        "sensor": vars(first.sensor),
        "ground_m": _ground([view for frame_views in views.values() for view in frame_views]),
        "min_score": MIN_SCORE,
        "boxes_of": _boxes_of(views),
        "note": f"{_note(lidars)}{DRAWN if around and around.roads else ''}",
        "around": _around(around),
        "lidars": lidars,
    }


def _boxes_of(views: Views) -> str:
    names = np.concatenate([view.names for frame_views in views.values() for view in frame_views])
    return "vehicles and people" if np.isin(names, PERSON_TYPES).any() else "vehicles"


def _around(around: Surroundings | None) -> dict[str, Any]:
    """Returns lines along the roads by kind, as flat lists of x y z, and buildings as boxes."""
    packed: dict[str, Any] = {key: [] for key in ("edge", "solid", "dashed", *STANDING)}
    if around is None:
        return packed
    for line in road_lines(around):
        parts = pieces(line.xyz, ~np.isnan(line.xyz[:, 0]), LINE_STEP)
        packed[line.kind] += [_short(part.ravel(), 2) for part in parts]
    for key in STANDING:
        packed[key] = [_short(row) for row in getattr(around, key)]
    return packed


def _common_frames(views: Views) -> list[int]:
    lists = {name: [view.frame for view in frame_views] for name, frame_views in views.items()}
    if not lists or not all(lists.values()):
        raise Error("view: expected one or more frames for each LiDAR, got none")
    frames = next(iter(lists.values()))
    for name, numbers in lists.items():
        if numbers != frames:
            raise Error(
                f"view: {name}: expected frames {frames}, as for the first LiDAR, got {numbers}"
            )
    return frames


def _frame(view: ViewFrame, most_points: int | None) -> dict[str, Any]:
    hits = [None] * len(view.boxes) if view.hits is None else view.hits.tolist()
    vehicles = zip(view.names, view.boxes, hits, strict=True)
    packed: dict[str, Any] = {
        "points": pack_points(view, most_points),
        "vehicles": [{"name": str(n), "box": _short(b), "points": h} for n, b, h in vehicles],
    }
    predictions = view.predictions
    if predictions is not None and predictions.scores is not None:
        rows = zip(predictions.names, predictions.boxes, predictions.scores, strict=True)
        packed["predictions"] = [
            {"name": str(n), "box": _short(b), "score": round(float(s), 4)} for n, b, s in rows
        ]
        packed["trails"] = [_short(trail.ravel(), 2) for trail in view.trails]
    return packed


def _short(values: FloatArray, digits: int = 4) -> list[float]:
    return [round(float(value), digits) for value in values]


def _ground(views: Sequence[ViewFrame]) -> float:
    """Returns the height of the ground.

    It is the median of the box bottoms. If there are no boxes, it is the known height of the road,
    or else a low percentile of the points. If there are no points either, it is 0.
    """
    boxes = np.concatenate([view.boxes for view in views])
    if len(boxes):
        return float(np.median(boxes[:, 2] - boxes[:, 5] / 2))
    if (road_z := views[0].road_z) is not None:
        return road_z
    heights = np.concatenate([view.points[:, 2] for view in views])
    return float(np.percentile(heights, _GROUND_PERCENTILE)) if len(heights) else 0.0


def _note(lidars: Sequence[Mapping[str, Any]]) -> str:
    """Returns a note on how to use the view and on what it leaves out."""
    packed = [frame["points"] for lidar in lidars for frame in lidar["frames"]]
    step = max((p["step_m"] for p in packed), default=STEP_M)
    note = (
        "Drag to turn; right button or two fingers to move; wheel or pinch to zoom; or the arrow "
        "keys, with Shift to move, + and -. Point at a box to read it. Squares on the ground are "
        f"20 m wide; positions are rounded to {100 * step:.2g} cm."
    )
    if any(p["count"] < p["of"] for p in packed):
        note += " Some frames have more points than are shown: see the count of each."
    return note
