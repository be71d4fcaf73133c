"""No function of the public API waits for a FIFO: as an argument, or in a folder of frames.

Nothing writes to the FIFOs of these tests, so that a function that opened one would not end.
"""

from __future__ import annotations

import inspect
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import pyinfra as pi
from pyinfra.core.files import regular_files_only

LONGEST_S = 200  # the machine may be busy
# Parts of file names for functions that look at them.
SUFFIXES = {
    "export_tracks: file": ".jsonl",
    "import_map: file": ".xodr",
    "import_mesh: file": ".ply",
    "import_trajectories: file": ".csv",
    "plan: areas": ".csv",
    "plan: costs": ".csv",
    "plan: poses": ".csv",
    "view: out": ".html",
    "draw_site: out": ".svg",
    "propose_region: out": ".yaml",
    "report: out": ".html",
    "detect: region": ".yaml",
    "train: config": ".yaml",
    "benchmark: config": ".yaml",
    "train: start": ".safetensors",
}

LISTS = {"plan: lidars", "report: data", "report: runs"}
# Words in annotations of arguments that can be paths.
PATHS = ["StrPath", "PathLike", "AnyData", "AnyPredictions", "AnyFrames", "AnyScene"]
PATHS += ["AnyRegion", "AnyLines", "AnyLidar"]


@pytest.fixture(autouse=True)
def not_waiting() -> Iterator[None]:
    """Raises an error in a test that waits for a FIFO."""

    def stop(*_: object) -> None:
        raise AssertionError(f"the test took more than {LONGEST_S} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


class Inputs:
    """Valid arguments of the public functions that have a path among their arguments."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        scene = pi.load_scene("highway", set={"duration_s": 2, "traffic.warm_up_s": 5})
        self.frames = pi.simulate(scene, "helios_16", range(0, 20, 10))
        self.data = pi.export(self.frames, "kitti", folder / "data")
        self.lidar = next(path for path in self.data.iterdir() if path.is_dir())
        table = self.frames.labels.assign(score=0.5)
        self.table = pi.Detections(table)
        self.found = self.table.save(folder / "found", self.frames.numbers)
        self.site = folder / "site"
        self.site.mkdir()
        (self.site / "site.yaml").write_text("name: a\n")

    def arguments(self, function: str) -> dict[str, Any]:
        """Returns the arguments of a function."""
        data, found, out = self.lidar, self.found, self.folder / "out"
        every: dict[str, dict[str, Any]] = {
            "benchmark": {"config": "demo", "out": out, "work": out},
            "count": {"tracks": self.table, "site": self.frames},
            "detect": {"model": lambda points: [], "frames": self.frames, "region": None},
            "draw_site": {"site": self.site, "out": out / "a.svg"},
            "evaluate": {"gt": data, "pred": found},
            "evaluate_tracks": {"frames": self.frames, "tracks": self.table},
            "export": {"frames": self.frames, "format": "pcd", "out": out},
            "export_tracks": {
                "tracks": pi.track(self.table, self.frames),
                "file": out / "tracks.csv",
            },
            "export_onnx": {"model": "generalist", "out": out / "m.onnx"},
            "import_map": {"file": data, "out": out},
            "import_mesh": {"file": data, "site": self.site},
            "import_recording": {"source": data, "format": "pcd", "out": out / "a"},
            "import_trajectories": {"file": data, "site": self.site, "in_world": True},
            "load_dataset": {"folder": data},
            "load_detector": {"model": "generalist"},
            "load_lidar": {"lidar": "helios_16"},
            "load_scene": {"scene": "highway"},
            "make_sites": {"out": out, "count": 1},
            "pictures": {"data": data, "out": out},
            "plan": {"scene": "crossroad", "budget_usd": 9000.0, "lidars": ["helios_16"]},
            "plot_scene": {"scene": "highway"},
            "plot_stress": {"rows": data, "stressor": "rain"},
            "propose_region": {"data": data},
            "recommend": {"results": data},
            "report": {"results": data, "out": out / "r.html"},
            "simulate": {"scene": "highway", "lidar": "helios_16", "frames": range(1)},
            "simulate_traffic": {"site": self.site},
            "split": {"data": data, "by": "time"},
            "statistics": {"data": data},
            "stress": {"models": "generalist", "data": data, "work": out},
            "train": {"config": "pointpillars", "frames": data, "work": out, "steps": 1},
            "trust": {"data": data, "predictions": found},
            "validate": {"data": data, "predictions": found},
            "view": {"data": data, "out": out / "v.html"},
        }
        return every[function]


def path_parameters() -> list[str]:
    """Returns function and parameter of each argument of the public API that can be a path."""
    functions = {name: getattr(pi, name) for name in pi.__all__}
    return [
        f"{name}: {parameter.name}"
        for name, function in functions.items()
        if inspect.isfunction(function)
        for parameter in inspect.signature(function).parameters.values()
        if any(word in str(parameter.annotation) for word in PATHS)
    ]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.mark.parametrize("case", path_parameters())
def test_a_fifo_is_no_argument(
    case: str, inputs: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name, parameter = case.split(": ")
    fifo = tmp_path / f"fifo{SUFFIXES.get(case, '')}"
    os.mkfifo(fifo)
    value = [fifo] if case in LISTS else fifo
    with pytest.raises(pi.Error):
        getattr(pi, name)(**{**inputs.arguments(name), parameter: value})
    assert fifo.is_fifo()


def frames_in(folder: Path) -> pi.FrameSequence:
    frames = pi.load_dataset(folder)
    assert isinstance(frames, pi.FrameSequence)
    return frames


READERS: dict[str, Callable[[Path, Path], object]] = {
    "points": lambda lidar, _: [frame.points for frame in frames_in(lidar)],
    "fields": lambda lidar, _: [frame.fields for frame in frames_in(lidar)],
    "objects": lambda lidar, _: frames_in(lidar).objects,
    "region": lambda lidar, _: frames_in(lidar).region,
    "detect": lambda lidar, _: pi.detect(lambda points: [], lidar),
    "evaluate": pi.evaluate,
    "evaluate_tracks": lambda lidar, found: pi.evaluate_tracks(
        frames_in(lidar), pi.track(pi.Detections.from_kitti(found, lidar), frames_in(lidar))
    ),
    "export": lambda lidar, found: pi.export(lidar, "openpcdet", found.parent / "out"),
    "pictures": lambda lidar, found: pi.pictures(lidar, found.parent / "out"),
    "split": lambda lidar, _: pi.split(lidar.parent, "time"),
    "statistics": lambda lidar, _: pi.statistics(lidar.parent),
    "validate": pi.validate,
    "view": lambda lidar, found: pi.view(lidar, found.parent / "v.html", predictions=found),
}


def files_of(inputs: Inputs) -> list[Path]:
    """Returns one file of each kind in the folders of data and of predictions."""
    folders = (inputs.data, inputs.found)
    every = [path for folder in folders for path in sorted(folder.rglob("*")) if path.is_file()]
    names = {file: "" if file.stem.isdecimal() else file.stem for file in every}
    of_kind = {(file.parent, file.suffix, names[file]): file for file in every}
    return [file.relative_to(inputs.folder) for file in of_kind.values()]


@pytest.mark.parametrize("reader", READERS)
def test_a_fifo_in_a_folder_is_not_opened(reader: str, inputs: Inputs, tmp_path: Path) -> None:
    """Each kind of file is a FIFO once. A function may treat it as missing."""
    for k, name in enumerate(files_of(inputs)):
        copy = tmp_path / str(k)
        shutil.copytree(inputs.folder, copy, ignore=shutil.ignore_patterns("out*", "site"))
        (copy / name).unlink(missing_ok=True)
        os.mkfifo(copy / name)
        with suppress(pi.Error, FileNotFoundError):
            READERS[reader](copy / inputs.lidar.relative_to(inputs.folder), copy / "found")
        assert (copy / name).is_fifo()  # and no file in its place


def test_a_detector_may_use_a_fifo(inputs: Inputs, tmp_path: Path) -> None:
    """Only the paths of the arguments are checked: a detector of the user may run elsewhere."""
    os.mkfifo(tmp_path / "answers")
    sent = os.open(tmp_path / "answers", os.O_RDWR)

    def ask(points: Any) -> list[list[float]]:
        os.write(sent, b"10 0 1 4 2 1.5 0\n")
        with (tmp_path / "answers").open("rb", buffering=0) as stream:
            return [[float(word) for word in stream.read(100).split()]]

    assert len(pi.detect(ask, inputs.lidar)) == 2
    os.close(sent)


def test_calls_in_threads_do_not_end_the_check_of_each_other(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    first, second = regular_files_only([tmp_path]), regular_files_only([tmp_path])
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    with pytest.raises(pi.Error, match="expected a regular file, got a FIFO"):
        (tmp_path / "fifo").read_bytes()
    second.__exit__(None, None, None)
    fd = os.open(tmp_path / "fifo", os.O_RDWR)  # no call runs, so that this opens
    os.close(fd)
