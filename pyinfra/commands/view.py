"""Eyes on data: `pyinfra view DATA --frames 0:50:5 --out view.html`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from pyinfra import kitti
from pyinfra.atomic import replacing
from pyinfra.data.frames import lidar_folders
from pyinfra.viewer.frames import ViewFrame, read_view_frames
from pyinfra.viewer.page import Views, page

LARGEST_MB = 40.0  # of a page


def read_views(
    folders: Sequence[Path], frames: Sequence[int], predictions: Mapping[Path, Path]
) -> dict[str, list[ViewFrame]]:
    """Frames of LiDAR folders by the LiDAR's model, with the data set where two are the same.

    predictions: folders of predictions by LiDAR folder. Raises what read_view_frames() raises.
    """
    names = _names(folders)
    return {
        name: read_view_frames(folder, frames, predictions.get(folder))
        for name, folder in zip(names, folders, strict=True)
    }


def write_page(views: Views, title: str, out: Path, most_points: int | None = None) -> int:
    """Writes the page and returns its size in bytes.

    Raises ValueError, and writes nothing, above LARGEST_MB and if `out` is a folder.
    """
    check_file(out)
    text = page(views, title=title, most_points=most_points).encode()
    if len(text) > 1e6 * LARGEST_MB:
        raise ValueError(
            f"{out}: found {len(text) / 1e6:.1f} MB, allowed {LARGEST_MB:g} MB: "
            "fewer --frames, one --lidar, or --most-points"
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as beside:
        beside.write_bytes(text)
    return len(text)


def check_file(out: Path) -> None:
    """Raises ValueError if a file cannot be written there because a folder has its name."""
    if out.is_dir():
        raise ValueError(f"--out: found the folder {out}, allowed the name of a file")


def chosen_folders(data: Sequence[Path], lidars: Sequence[str] | None) -> list[Path]:
    """The LiDAR folders of data sets and LiDAR folders, those named in `lidars` if any are.

    Raises FileNotFoundError for a folder that is neither, and ValueError for an unknown LiDAR.
    """
    folders = []
    for path in data:
        folders += [path] if (path / "training").is_dir() else lidar_folders(path)
    if lidars is None:
        return folders
    known = [folder.name for folder in folders]
    for name in lidars:
        if name not in known:
            raise ValueError(f"--lidar: found '{name}', allowed {', '.join(known)}")
    return [folder for folder in folders if folder.name in lidars]


def chosen_frames(folder: Path, words: str | None, predictions: Path | None = None) -> list[int]:
    """The frames of a folder in A:B or A:B:STEP, or frame A alone; the first without words.

    predictions: the first frame is then the first that has some.

    Raises ValueError for other words, and for a folder that has none of them.
    """
    present = kitti.frames(folder)
    if words is None:
        stems = {file.stem for file in predictions.iterdir()} if predictions else set()
        return [frame for frame in present if f"{frame:06d}" in stems][:1] or present[:1]
    try:
        numbers = [int(word) for word in words.split(":")]
        wanted = range(numbers[0], numbers[0] + 1) if len(numbers) == 1 else range(*numbers)
    except (TypeError, ValueError):
        raise ValueError(f"--frames: found '{words}', allowed A:B or A:B:STEP") from None
    found = [frame for frame in present if frame in wanted]
    if not found:
        raise ValueError(f"{folder}: found no frame of {words}, allowed {kitti.extent(present)}")
    return found


def prediction_folders(words: Sequence[str], folders: Sequence[Path]) -> dict[Path, Path]:
    """Folders of predictions by LiDAR folder, from LIDAR=DIR, or DIR if there is one LiDAR.

    Raises ValueError for an unknown LiDAR, and for DIR with several.
    """
    by_name = {folder.name: folder for folder in folders}
    chosen = {}
    for word in words:
        name, equals, folder = word.partition("=")
        if not equals and len(folders) == 1:
            name, folder = folders[0].name, word
        if name not in by_name or not folder:
            raise ValueError(
                f"--pred: found '{word}', allowed LIDAR=DIR with LIDAR {', '.join(by_name)}"
            )
        chosen[by_name[name]] = Path(folder)
    return chosen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "An interactive 3-D view of one frame or several, of one LiDAR or several that see one "
        "world, as one HTML file that needs no network."
    )
    parser.epilog = "example: pyinfra view data/highway --frames 0:50:5 --out out/view.html"
    parser.add_argument(
        "data", nargs="+", type=Path, help="data set of `infrasim run`, or folder of a LiDAR"
    )
    parser.add_argument("--lidar", nargs="+", metavar="NAME", help="only these LiDARs")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--frame", type=int, help="by default the first, or the first with predictions"
    )
    frames.add_argument("--frames", metavar="A:B[:STEP]", help="those of A to B - 1 that exist")
    parser.add_argument(
        "--pred",
        nargs="+",
        default=[],
        metavar="DIR",
        help="predictions as NNNNNN.txt or .csv; LIDAR=DIR for each of several LiDARs",
    )
    parser.add_argument(
        "--most-points", type=int, metavar="N", help="thin frames with more; the page says so"
    )
    parser.add_argument(
        "--rerun",
        action="store_true",
        help="write a recording (.rrd) for Rerun instead and open it (extra `rerun`); Rerun's "
        "program reports its use to its makers until `rerun analytics disable`",
    )
    parser.add_argument("--out", type=Path, required=True, help="the file to write")


def run(args: argparse.Namespace) -> int:
    if args.most_points is not None and args.most_points < 1:
        raise ValueError(f"--most-points: found {args.most_points}, allowed 1 or more")
    check_file(args.out)
    folders = chosen_folders(args.data, args.lidar)
    predictions = prediction_folders(args.pred, folders)
    words = str(args.frame) if args.frame is not None else args.frames
    frames = chosen_frames(folders[0], words, predictions.get(folders[0]))
    views = read_views(folders, frames, predictions)
    if args.rerun:
        from pyinfra.viewer import recording

        size = recording.write(views, args.out)
    else:
        size = write_page(views, _title(folders, frames), args.out, args.most_points)
    count = (
        f"{len(views)} LiDAR{'s'[: len(views) > 1]}, {len(frames)} frame{'s'[: len(frames) > 1]}"
    )
    print(f"{args.out}: {size / 1e6:.2f} MB, {count}")
    if args.rerun:
        recording.open_viewer(args.out)
    return 0


def _title(folders: Sequence[Path], frames: Sequence[int]) -> str:
    scenes = dict.fromkeys(folder.resolve().parent.name for folder in folders)
    last = f" to {frames[-1]}" if len(frames) > 1 else ""
    return f"{', '.join(scenes)}: frame{'s' if last else ''} {frames[0]}{last}"


def _names(folders: Sequence[Path]) -> list[str]:
    """Models of the LiDARs; where two are the same, with data set and folder."""
    models = [
        kitti.read_lidar(folder).model if (folder / "lidar.yaml").is_file() else folder.name
        for folder in folders
    ]
    names = [
        f"{model} ({'/'.join(folder.resolve().parts[-2:])})" if models.count(model) > 1 else model
        for model, folder in zip(models, folders, strict=True)
    ]
    if len(set(names)) < len(names):
        raise ValueError(f"found {', '.join(map(str, folders))}, allowed each LiDAR once")
    return names
