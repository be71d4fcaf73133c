"""Runs any detector on frames in memory and returns its boxes as a table."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from pyinfra.core.arrays import Points, concatenated
from pyinfra.core.errors import Error
from pyinfra.core.files import write as write_bytes
from pyinfra.core.names import StrPath, path_of, suggestion
from pyinfra.core.present import Presented
from pyinfra.core.progress import track
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.frames import spread
from pyinfra.dataset.ground import CHECKED, height_warnings
from pyinfra.dataset.loading import AnyFrames, sequence_of
from pyinfra.dataset.outlines import Drawn
from pyinfra.dataset.regions import drawn_of, read_outline, region_within
from pyinfra.models.detectors import Detector
from pyinfra.models.detectors.suppression import empty
from pyinfra.models.inference import detect as inference
from pyinfra.models.inference.detections import Detections, table_of
from pyinfra.models.inference.folder import Place, detector_at_place, region_warning, replaced
from pyinfra.models.inference.frames_learnt import frames_warning
from pyinfra.models.inference.own_detector import OwnDetector, detections_of_own
from pyinfra.models.inference.static_filter import length_warning, without_standing
from pyinfra.models.inference.threads import checked_threads

AnyRegion: TypeAlias = "npt.ArrayLike | str | os.PathLike[str]"


@dataclass(frozen=True, repr=False)
class TrainedDetector(Presented):
    """A trained detector's file. `detect` loads it and adapts it to the site of the frames.

    Attributes
    ----------
    file : file of the weights
    device : device of PyTorch
    threads : number of threads that process a frame
    """

    file: Path
    device: str = "cpu"
    threads: int = 1

    def facts(self) -> dict[str, object]:
        return {"file": self.file.name, "device": self.device, "threads": self.threads}

    def __call__(self, points: AnyFrames, **options: Any) -> Detections:
        """Returns the boxes in one cloud or several; `options` are those of `detect`."""
        return detect(self, points, **options)

    def save(self, file: StrPath) -> Path:
        """Copies the weights to a file, and returns its path."""
        to = path_of(file, "file")
        to.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(to, self.file.read_bytes())
        return to


OWN: dict[str, Any] = {}  # detectors that the user registered, by name


@public()
def register_detector(detector: Callable[..., Any], name: str | None = None) -> Any:
    """Gives a detector of your own a name, which `load_detector` and `detect` accept.

    Parameters
    ----------
    detector : a detector as `detect` accepts it, or a class without required arguments, of which an
        object is made when the detector is loaded; the function can be used as a decorator
    name : the name; by default that of the class or function

    Returns
    -------
    The given detector

    Raises
    ------
    Error : for a name of a shipped detector, and for something that is not callable

    Examples
    --------
    >>> import numpy as np
    >>> import pyinfra as pi
    >>> @pi.register_detector
    ... class Nothing:
    ...     def predict(self, points):
    ...         return np.empty((0, 7))
    >>> len(pi.detect("Nothing", np.zeros((5, 4))))
    0
    """
    word = name or getattr(detector, "__name__", "")
    if not word or word in inference.shipped():
        raise Error(f"name: expected a name that no pretrained detector has, got '{word}'")
    OWN[word] = detector
    return detector


@public()
def list_detectors() -> list[str]:
    """Returns the names of detectors that `load_detector` accepts.

    Parameters
    ----------
    None

    Returns
    -------
    Names, sorted: the pretrained detectors, and those of `register_detector`

    Raises
    ------
    Error : for an argument

    Examples
    --------
    >>> import pyinfra as pi
    >>> "generalist" in pi.list_detectors()
    True
    """
    return sorted([*inference.shipped(), *OWN])


@public(threads=(1, math.inf))
def load_detector(
    model: str | os.PathLike[str] = "generalist",
    *,
    device: str = "cpu",
    threads: int | None = None,
) -> TrainedDetector | Any:
    """Selects a detector for `detect`: the pretrained detector of the package, or a trained model.

    Parameters
    ----------
    model : `generalist` for the pretrained detector, the name of a detector of `register_detector`,
        or the folder of a training, or a file in it
    device : device of PyTorch, such as `cpu` or `cuda`
    threads : number of threads that process a frame; by default one per core, at most 4. Only the
        detector `centerpoint-pillar` on a CPU uses this number. The pretrained detector is of this
        kind. Boxes do not depend on the number of threads

    Returns
    -------
    TrainedDetector : an argument for `detect`, which reads the weights

    Raises
    ------
    Error : for a name, folder or file without a model, and for less than one thread

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_detector("generalist").file.name
    'generalist.safetensors'
    """
    if isinstance(model, str) and model in OWN:
        return OWN[model]() if isinstance(OWN[model], type) else OWN[model]
    try:
        file = inference.model_file(path_of(model, "model"))
    except FileNotFoundError:
        near = suggestion(os.fspath(model), [*inference.shipped(), *OWN])
        raise Error(
            "model: expected the folder of a trained detector, a model file or the name of a "
            f"detector, got '{model}'{near}"
        ) from None
    return TrainedDetector(file, device, checked_threads(threads))


@public()
def detect(
    model: TrainedDetector | Detector | OwnDetector | str | os.PathLike[str],
    frames: AnyFrames,
    *,
    height_m: float | None = None,
    region: AnyRegion | None = None,
    drop_standing: bool = False,
) -> Detections:
    """Runs a detector on frames and returns its boxes.

    For a trained detector, z of the points is converted to height above the road, and frames are
    stacked as in the training of the detector. `attrs["inputs"]` of the result is a text that says
    which inputs were used.

    The function warns if the road in the clouds is not `height_m` below the sensor. It also warns
    if a trained network has no region, if it was learnt from frames of a different frames_version,
    and if the frames are too short for `drop_standing`.

    Parameters
    ----------
    model : a result of `load_detector`, a value that its argument `model` accepts, or a detector of
        your own: an object with a method `predict`, or else any callable. It gets points (n, 4)
        float32, x y z intensity, in the levelled LiDAR frame, as an array that it may change. It
        returns boxes in the same frame, in metres and radians: a table with the columns x y z dx dy
        dz heading, type (default `vehicle`) and score (default 1); an array, tensor or list (n, 7)
        of these numbers, or (n, 8) with the score; or a dict with `boxes`, `scores` and `names`
    frames : frames of `simulate` or `load_dataset`, or a LiDAR's folder; or points (n, 4) of one
        cloud, or a list of clouds, which are frames 0, 1, ... without labels, roads and height
    height_m : height of the sensor above a level road, for a trained detector; by default the
        height is read from the frames
    region : area where vehicles can be, for a trained detector. The argument is the corners (m, 2)
        of an outline in the levelled LiDAR frame, metres; a dict of `outlines_m` and `holes_m`,
        which are lists of such corners; a polygon of shapely; the result of `propose_region`; or a
        file with `outline_m: [[x, y], ...]`. By default the area is the roads of the frames
    drop_standing : whether to remove vehicle boxes that recur at a position where no box ever
        moves, such as boxes on hedges; needs frames that span a minute or more

    Returns
    -------
    Detections : a table with the columns frame, type, x y z dx dy dz heading, score; ordered by
        frame, then best first

    Raises
    ------
    Error : for an unknown model, a callable that fails or returns another kind of object, for an
        invalid height or region, and for a region that would have no effect

    Examples
    --------
    >>> import pandas as pd
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 20, 10))
    >>> def nothing(points):
    ...     return pd.DataFrame(columns=["x", "y", "z", "dx", "dy", "dz", "heading", "score"])
    >>> pi.detect(nothing, frames).shape
    (0, 10)
    """
    frames = sequence_of(frames, "frames")
    if isinstance(model, (str, os.PathLike)):
        model = load_detector(model)
    site = _place(frames, height_m, region)
    if site.height_m is not None:
        clouds = [frames.frame(k).points for k in spread(frames.numbers, CHECKED)]
        for text in height_warnings(clouds, site.height_m):
            warnings.warn(text, stacklevel=CALLER)
    numbers, inputs = frames.numbers, "single frames"
    if isinstance(model, TrainedDetector):
        inputs = inference.inputs_used(model.file)
        if text := region_warning(model.file, site):
            warnings.warn(f"{text}; `region` takes an outline of the road", stacklevel=CALLER)
        if text := frames_warning(model.file, frames.frames_version):
            warnings.warn(text, stacklevel=CALLER)
        detector = detector_at_place(model.file, site, model.device, model.threads)
        per_frame = [
            detector.predict(points) for points in track(_stacked(model.file, frames), "frame")
        ]
    elif region is not None and not drop_standing:
        raise Error(
            "region: expected no value for a detector of your own, got an outline; such a detector "
            "gets all points, and all of its boxes are returned"
        )
    elif callable(own := getattr(model, "predict", model)):
        per_frame = [detections_of_own(f.number, own, f.points) for f in track(frames, "frame")]
    else:
        raise Error(f"model: expected a detector or a callable, got {type(model).__name__}")
    if drop_standing and numbers:
        if text := length_warning(numbers, frames.period_s):
            warnings.warn(text, stacklevel=CALLER)
        reads = [partial(frames.points_of, k) for k in numbers]
        per_frame = without_standing(reads, per_frame, site.region, site.ground)
    every = concatenated([empty(), *per_frame])
    counts = [len(of_frame) for of_frame in per_frame]
    frame = np.repeat(np.asarray(numbers, np.int64), counts)
    table = table_of(frame, every.names, every.boxes, every.scores)
    table.attrs["inputs"] = inputs
    return table


def _place(frames: FrameSequence, height_m: float | None, region: AnyRegion | None) -> Place:
    """Returns ground and region of the frames. Arguments that are not None replace them."""
    inside = None if region is None else region_within(_drawn(region))
    return replaced(frames.ground, frames.region, height_m, inside)


def _drawn(region: AnyRegion) -> Drawn:
    """Returns the area that the argument `region` describes. Raises Error if it is invalid."""
    if isinstance(region, (str, os.PathLike)):
        return read_outline(Path(region))
    try:
        return drawn_of(region)
    except Error as error:
        raise Error(f"region: {error}") from None


def _stacked(model: Path, frames: FrameSequence) -> Iterator[Points]:
    """Returns the clouds of the frames, stacked as in the model's training."""
    accumulation = inference.accumulation_of(model)
    if accumulation.frames == 1:
        return (frame.points for frame in frames)
    clouds = accumulation.clouds(frames.points_of, frames.numbers, frames.known, frames.period_s)
    return (cloud() for cloud in clouds)
