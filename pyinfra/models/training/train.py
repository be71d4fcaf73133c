"""Trains a detector from a recipe and frames."""

from __future__ import annotations

import filecmp
import hashlib
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml
from tqdm import tqdm

from pyinfra.core.arrays import FloatArray
from pyinfra.core.config import as_plain
from pyinfra.core.errors import ConfigError, Error
from pyinfra.core.files import alone, replacing, write
from pyinfra.core.progress import Lines, is_shown
from pyinfra.models.detectors.background import background_of
from pyinfra.models.inference.detect import model_file
from pyinfra.models.pytorch import need_pytorch
from pyinfra.models.training.provenance import Provenance, read_provenance
from pyinfra.models.training.recipe import Precision, Recipe
from pyinfra.models.training.samples import Frames
from pyinfra.models.training.sources import Source, Stream, common_label_time, on_road

if TYPE_CHECKING:
    from pyinfra.models.detectors.network import Network
    from pyinfra.models.training.loop import Progress
    from pyinfra.models.training.resumption import Description


OF_CLASSES = {"head.heat.weight", "head.heat.bias"}  # weights with one row per class

# Arguments that only networks use, with their defaults.
OF_NETWORKS = {"seed": 1, "device": "cpu", "precision": "float32", "budget": 1.0, "start": None}


def train(
    recipe: Recipe,
    sources: Sequence[Source] | Stream,
    out: Path,
    *,
    seed: int = 1,
    device: str = "cpu",
    precision: Precision = "float32",
    quiet: bool = False,
    watch: Callable[[Progress], None] | None = None,
) -> Path:
    """Trains a detector and writes it to the folder `out`; returns the model's file.

    If `out` has a checkpoint of this training, the training resumes. If the recipe has 0 steps, the
    network `start` of the recipe is copied. watch: called after each step. Raises the errors of
    reading frames and of training.
    """
    out.mkdir(parents=True, exist_ok=True)
    other_model = "last.safetensors" if recipe.detector == "background" else "background.npz"
    if (out / other_model).exists():
        raise FileExistsError(
            f"{out}: expected a folder without a model of a different detector, got {other_model}; "
            "choose a different folder"
        )
    if recipe.detector == "background":
        return _learn_background(recipe, sources, out)
    if recipe.learning.steps == 0:
        return _as_it_comes(recipe, out)
    return _train_network(recipe, sources, out, seed, device, precision, quiet, watch)


def _as_it_comes(recipe: Recipe, out: Path) -> Path:
    """Copies the network `start` to the folder `out` without training; returns the new file.

    Raises FileNotFoundError, FileExistsError if the folder has another network, and ConfigError if
    the network is that of another detector.
    """
    source, model = model_file(Path(recipe.learning.start)), out / "last.safetensors"
    if model.exists() and not filecmp.cmp(source, model, shallow=False):
        raise FileExistsError(
            f"{out}: expected a folder without a model or with the model {source.name}, got a "
            f"{model.name} of a different network; choose a different folder"
        )
    detector = read_provenance(source).detector
    if detector != recipe.detector:
        raise ConfigError(
            f"{recipe.learning.start}: expected a model of {recipe.detector}, got a model of "
            f"{detector}"
        )
    with replacing(model) as beside:
        shutil.copyfile(source, beside)
    return model


def _learn_background(recipe: Recipe, sources: Sequence[Source] | Stream, out: Path) -> Path:
    if isinstance(sources, Stream):
        raise Error("background: expected frames of one LiDAR, got a stream of random sites")
    if len(sources) != 1:
        raise Error(f"background: expected frames of one LiDAR, got those of {len(sources)} LiDARs")
    (source,) = sources
    if source.accumulation.frames > 1:
        raise Error(
            f"accumulate: expected 1 for background, got {source.accumulation.frames}; background "
            "uses single frames"
        )
    file = out / "background.npz"
    background = background_of(source.clouds, source.region, source.ground, recipe.network)
    background.save(file, source.frames_version)
    return file


def _train_network(
    recipe: Recipe,
    sources: Sequence[Source] | Stream,
    out: Path,
    seed: int,
    device: str,
    precision: Precision,
    quiet: bool,
    watch: Callable[[Progress], None] | None,
) -> Path:
    need_pytorch()
    import torch

    from pyinfra.models.detectors import distributed
    from pyinfra.models.detectors.network import device_of
    from pyinfra.models.training import checkpoint, loop, resumption

    stream, held_out = _stream(sources, recipe.learning.validate_frames)
    frames = stream.samples
    torch.manual_seed(seed)
    network = checkpoint.build(recipe.detector, recipe.network, stream.site)
    for key, is_supported in (
        ("window_m2", network.learns_in_windows),
        ("balance", network.balances_frames),
    ):
        value = getattr(recipe.learning, key)
        if value > 0 and not is_supported:
            name = type(network).__name__
            raise Error(f"learning.{key}: expected 0 for {name}, got {value:g}")
    if getattr(recipe.network, "age", False) and stream.accumulation.frames == 1:
        raise Error("network.age: expected false for single frames, got true")
    if network.classes != stream.classes:
        raise Error(
            f"network.classes: expected {', '.join(stream.classes)} as in the labels, got "
            f"{', '.join(network.classes)}"
        )
    provenance = _provenance(recipe, stream, seed)
    if recipe.learning.start:
        provenance = _begun_with(network, Path(recipe.learning.start), provenance)
    description = resumption.Description(
        **vars(provenance),
        learning=recipe.learning,
        augmentation=recipe.augmentation,
        frames=len(frames),
        precision=precision,
        drawn=stream.drawn,
    )
    with distributed.joined(device_of(device)) as torch_device:
        distributed.check_batch(recipe.learning.batch)
        # All processes are connected here, so all of them read the same checkpoint.
        begun = resumption.read_begun(out, description)
        done = begun.provenance.step if begun is not None else 0
        first = distributed.rank() == 0
        with (
            alone(out) if first else nullcontext(),
            _reporting(out, description, done, quiet, watch) if first else nullcontext() as report,
        ):
            loop.train(
                network,
                frames,
                recipe,
                provenance,
                out,
                begun=begun,
                held_out=held_out,
                device=torch_device,
                precision=precision,
                report=report,
            )
    return out / "last.safetensors"


def _provenance(recipe: Recipe, stream: Stream, seed: int) -> Provenance:
    """Returns the description of the checkpoint before the first step."""
    return Provenance(
        detector=recipe.detector,
        network=as_plain(recipe.network),
        site=stream.site,
        lidar=stream.lidar,
        preset=stream.preset,
        scene=stream.scene,
        label_time=stream.label_time,
        ground=stream.ground.plane if stream.ground and not stream.ground.relief else None,
        anywhere=stream.anywhere,
        accumulate=stream.accumulation.frames,
        label_at=stream.accumulation.label_at,
        frames_version=stream.frames_version,
        seed=seed,
        step=0,
        steps=recipe.learning.steps,
    )


def _begun_with(network: Network, start: Path, provenance: Provenance) -> Provenance:
    """Loads the weights of the network `start`; returns the changed description of the checkpoint.

    `network` may have classes that `start` lacks. The weights of these classes stay random. The
    calibration is copied if both networks have the same classes. Raises FileNotFoundError, and
    ConfigError for weights that do not fit.
    """
    import torch

    from pyinfra.models.training import checkpoint

    file = model_file(start)
    loaded = checkpoint.load(file)
    weights, state = loaded.weights(), network.state_dict()
    index_of = {name: i for i, name in enumerate(loaded.classes)}
    if loaded.classes != network.classes:
        for key in OF_CLASSES & weights.keys() & state.keys():
            rows = [weights[key][index_of[c]] if c in index_of else row
                    for c, row in zip(network.classes, state[key], strict=True)]  # fmt: skip
            weights[key] = torch.stack(rows)
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        first = str(error).splitlines()[-1].strip()
        raise ConfigError(
            f"{start}: expected weights of this network, got weights that do not fit: {first}"
        ) from None
    line = loaded.provenance.calibration if loaded.classes == network.classes else None
    return replace(provenance, start=checkpoint.digest(file), calibration=line)


@contextmanager
def _reporting(
    out: Path,
    description: Description,
    done: int,
    quiet: bool,
    watch: Callable[[Progress], None] | None,
) -> Iterator[Callable[[Progress], None]]:
    """Writes `run.yaml`, and yields a function that displays and logs the progress of a step."""
    from pyinfra.models.training.loop import Log

    write(out / "run.yaml", yaml.safe_dump(as_plain(description), sort_keys=False))
    log, steps = Log(out / "log.csv", done), description.steps
    hidden = quiet or not is_shown()
    bar = tqdm(total=steps, initial=done, unit="step", disable=hidden, file=sys.stderr)
    lines = Lines("step", steps, done)

    def report(progress: Progress) -> None:
        log(progress)
        bar.set_postfix(loss=f"{progress.loss:.3f}", refresh=False)
        bar.update()
        if not quiet:
            lines.update()
        if watch is not None:
            watch(progress)

    with bar:
        yield report


def _stream(sources: Sequence[Source] | Stream, kept: int) -> tuple[Stream, Frames | None]:
    """Returns the training samples, and the held-out frames, which are None if `kept` is 0.

    kept: number of frames of each LiDAR to hold out. Raises Error for a stream if `kept` is not 0,
    and for the reasons of `_frames`.
    """
    from pyinfra.models.detectors.detection_area import site_of

    if isinstance(sources, Stream):
        if kept > 0:
            raise Error(
                f"learning.validate_frames: expected 0 for a stream of random sites, got {kept}"
            )
        return sources, None
    sources = [on_road(source) for source in sources]
    frames, held_out = _frames(sources, kept)
    lidar, preset, scene = (
        " ".join(sorted({getattr(source, name) for source in sources}))
        for name in ("lidar", "preset", "scene")
    )
    numbers = sorted({source.frames_version for source in sources} - {""})
    label_time = common_label_time(sources)
    regions = [source.region for source in sources if source.region is not None]
    site = site_of(frames.boxes, regions if len(regions) == len(sources) else ())
    ground = sources[0].ground if len(sources) == 1 else None
    stream = Stream(
        *(lidar, preset, scene, label_time, frames, site, ground),
        accumulation=sources[0].accumulation,
        classes=sources[0].classes,
        drawn=f"labels {_digest(frames.boxes)}",
        frames_version=" ".join(numbers),
    )
    return stream, held_out


def _digest(boxes: Sequence[FloatArray]) -> str:
    """Returns a short digest of the boxes of all frames."""
    made = hashlib.sha256()
    for of_frame in boxes:
        made.update(np.ascontiguousarray(of_frame).tobytes() + b"|")
    return made.hexdigest()[:12]


def _frames(sources: Sequence[Source], kept: int) -> tuple[Frames, Frames | None]:
    """Returns the training frames, and the held-out frames, which are None if `kept` is 0.

    The held-out frames are the last `kept` frames of each LiDAR.

    Raises Error if no frame is left to train on, or if the held-out frames have no vehicle.
    """
    learnt, held_out = Frames((), ()), Frames((), ())
    for source in sources:
        classes = source.read_classes() if len(source.classes) > 1 else ()
        height_m = source.ground.sensor_m if source.ground else 0.0
        heights_m = (height_m,) * len(source.clouds)
        of_lidar = Frames(source.clouds, source.read_boxes(), classes=classes, heights_m=heights_m)
        if 0 < len(of_lidar) <= kept:
            raise Error(
                f"learning.validate_frames: expected less than {len(of_lidar)}, the number of "
                f"frames of {source.lidar}, got {kept}"
            )
        learnt += of_lidar.part(slice(0, len(of_lidar) - kept))
        held_out += of_lidar.part(slice(len(of_lidar) - kept, None))
    if kept > 0 and not any(map(len, held_out.boxes)):
        raise Error(
            f"learning.validate_frames: expected one or more vehicles in the last {kept} frames, "
            "got none"
        )
    return learnt, held_out if kept > 0 else None
