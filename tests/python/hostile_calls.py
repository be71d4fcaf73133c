"""Calls all of `_core` with invalid arguments: python hostile_calls.py LOG SECONDS.

Arguments are arrays with wrong shapes, types, strides and memory positions, numbers that are NaN or
too large, and files of random bytes. An invalid call must raise one of REFUSED. A result must lie
in its valid range. The script writes each call to LOG before it makes the call, so that the test
that starts the script can report the last call if the process crashes. At the end it prints the
called functions and members of classes, with the names of core_members.py.
"""

import faulthandler
import os
import resource
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from core_members import record_calls
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pyinfra import _core

REFUSED = (ValueError, TypeError, OSError, MemoryError)
# memory limit of the process; larger requests fail as on a machine with less memory
MEMORY = 4 << 30
CALL_S = 100  # a call that takes longer counts as a hang
EXAMPLES = 40
V0_3 = Path(__file__).resolve().parents[1] / "data/v0_3/inputs"

CALLED = record_calls()
SECONDS = float(sys.argv[2])
LOG = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
FOLDER = Path(sys.argv[1]).parent / "files"  # folder of the files that calls write
INPUTS = FOLDER / "inputs"

whole = st.sampled_from(
    (
        *(0, 1, 2, 3, 5, 64, 1000, 2**16, -1, -2, -1000, -(2**31), -(2**63)),
        *(2**28 + 1, 2**31 - 1, 2**31, 2**33, 2**62, 2**63 - 1, 2**63),
    )
)
few = st.integers(-1, 6) | whole
real = st.sampled_from(
    (
        *(0.0, -0.0, 0.5, 1.0, 2.0, -1.0, 30.0, 360.0, 1e-320, 1e-30, 1e8, 1e30, 1e300, -1e300),
        *map(float, ("nan", "inf", "-inf")),
    )
)
word = st.sampled_from(["", "a", "pole", "datasheet", "paper", "\0", "../x", "a" * 5000, "\u0661"])


def logged(function: Callable[..., Any], *values: object, **named: object) -> Any:
    """Returns the result of a call, or None if the call raised an allowed error."""
    text = f"{getattr(function, '__name__', function)} {values!r} {named!r}".encode()[:20000]
    os.ftruncate(LOG, 0)
    os.pwrite(LOG, text, 0)
    faulthandler.dump_traceback_later(CALL_S, exit=True)
    try:
        return function(*values, **named)
    except REFUSED:
        return None
    finally:
        faulthandler.cancel_dump_traceback_later()


@st.composite
def table(draw: st.DrawFn, columns: int | None, kind: type[np.generic], sane: Any, odd: Any) -> Any:
    """Returns an array (n, columns) or (n,) of usual values, sometimes with unusual values or an
    unusual memory layout."""
    rows = draw(st.integers(0, 30))
    shape: tuple[int, ...] = (rows,) if columns is None else (rows, columns)
    cells = np.array(draw(st.lists(sane, min_size=1, max_size=12)))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    array = random.choice(cells, shape).astype(kind)
    how = draw(st.sampled_from(["good"] * 6 + ["values"] * 4 + list(ODD)))
    for value in draw(st.lists(odd, min_size=1, max_size=4)) if how == "values" else ():
        if array.size:
            with np.errstate(all="ignore"):
                array.flat[random.integers(array.size)] = np.array(value).astype(kind)
    return ODD[how](array) if how in ODD else array


def unaligned(array: np.ndarray) -> np.ndarray:
    free_space = np.zeros(array.nbytes + 1, np.uint8)[1:]
    out = free_space.view(array.dtype).reshape(array.shape)
    out[...] = array
    return out


ODD: dict[str, Callable[[np.ndarray], Any]] = {
    "turned": lambda a: a[::-1],
    "transposed": lambda a: a.T,
    "every second": lambda a: np.repeat(a, 2, axis=0)[::2],
    "unaligned": unaligned,
    "swapped": lambda a: a.astype(a.dtype.newbyteorder()),
    "wide": lambda a: np.broadcast_to(np.zeros(1, a.dtype), (2**31, a.shape[-1])),
    "flat": lambda a: a.reshape(-1),
    "deep": lambda a: a[None],
    "narrow": lambda a: a[..., :2],
    "without rows": lambda a: a[:0],
    "of objects": lambda a: a.astype(object),
    "half as wide": lambda a: a.astype(np.float16),
    "of words": lambda a: a.astype(str),
    "list": lambda a: a.tolist(),
    "none": lambda a: None,
}

long = whole.map(lambda n: min(n, 2**63 - 1))
metres = st.sampled_from([0.0, 0.5, 1.0, 1.5, 2.0, 10.0, -10.0])
positions = table(3, np.float32, metres, real)
triple = st.lists(few, min_size=3, max_size=3) | st.lists(few, max_size=4)


def within(indices: np.ndarray, end: int) -> None:
    assert ((indices >= 0) & (indices < max(end, 1))).all()


# --- what is called ------------------------------------------------------------------------------


@given(positions, few)
def farthest_points(xyz: Any, count: int) -> None:
    result = logged(_core.farthest_points, xyz, count)
    if result is not None:
        assert len(result) == count
        within(result, len(xyz))


@given(positions, positions, real, few)
def ball_query(points: Any, centres: Any, radius: float, limit: int) -> None:
    result = logged(_core.ball_query, points, centres, radius, limit)
    if result is not None:
        assert result[0].shape == (len(centres), limit)
        within(result[0], len(points))


@given(table(None, np.int64, st.integers(-50, 50), long), st.lists(few, max_size=4))
def shifted_pairs(keys: Any, steps: list[int]) -> None:
    if (
        isinstance(keys, np.ndarray)
        and keys.dtype == np.int64
        and keys.ndim == 1
        and keys.size < 99
    ):
        result = logged(_core.shifted_pairs, np.unique(keys), steps)
        if result is not None:
            kept = np.unique(keys).tolist()
            moved = np.repeat(np.array(steps, object), result[2])
            pairs = zip(result[0], result[1], moved, strict=True)
            assert all(kept[i] == kept[j] + step for i, j, step in pairs)
    logged(_core.shifted_pairs, keys, steps)


voxels = table(4, np.int64, st.integers(0, 3), long)
grid = st.lists(st.integers(1, 4), min_size=3, max_size=3)


@given(voxels, st.tuples(*[grid | triple] * 5))
def reached_voxels(coordinates: Any, sizes: tuple[list[int], ...]) -> None:
    result = logged(_core.reached_voxels, coordinates, *sizes)
    if result is not None:
        (inputs, outputs, counts), keys = result
        assert len(inputs) == len(outputs) == sum(counts)
        assert len(counts) == np.prod(sizes[1])
        within(inputs, len(coordinates))
        within(outputs, len(keys))
        within(keys, (int(coordinates[:, 0].max(initial=0)) + 1) * int(np.prod(sizes[4])))


@given(table(7, np.float64, metres, real), real, few)
def suppress(boxes: Any, iou: float, limit: int) -> None:
    result = logged(_core.suppress, boxes, iou, limit)
    if result is not None:
        assert len(result) <= limit
        within(result, len(boxes))


single = st.sampled_from([0.0, 0.5, -1.0])
odd_single = st.sampled_from([np.nan, np.inf, -np.inf, 1e38, -1e38])
maps = st.builds(np.zeros, st.tuples(*[st.integers(0, 3)] * 3), st.just(np.float32))


@given(
    table(4, np.float32, single, odd_single),
    st.tuples(st.tuples(real, real), real, real),
    st.tuples(
        table(2, np.float32, single, odd_single), table(None, np.float32, single, odd_single), few
    ),
    st.tuples(
        table(2, np.float32, single, odd_single), table(None, np.float32, single, odd_single), few
    ),
    maps | table(2, np.float32, single, odd_single),
)
def pillar_map(points: Any, grid: Any, encoder: Any, layer: Any, cells: Any) -> None:
    logged(_core.pillar_map, points, *grid, *encoder, *layer, cells)


@given(table(4, np.float32, single, odd_single), maps, st.integers(-1, 5), st.integers(0, 3))
def pillar_map_that_fits(points: Any, cells: Any, first: int, stride: int) -> None:
    weight, bias = np.ones((4, 5), np.float32), np.ones(5, np.float32)
    outputs = cells.shape[0]
    layer = np.ones((45, outputs), np.float32), np.ones(outputs, np.float32), stride
    logged(_core.pillar_map, points, (-2.0, -2.0), 0.0, 0.5, weight, bias, first, *layer, cells)


corners = st.lists(st.tuples(real, real), max_size=5)
reals = st.lists(real, min_size=3, max_size=3)
SIZES = st.sampled_from("window_m height_m cell_m azimuth_cell_deg max_range_m".split())
NUMBERS = {"CropRange": 2, "CropFieldOfView": 4, "GroundHeight": 1, "GroundPlane": 3}
FILTERS: dict[str, st.SearchStrategy[Any]] = {
    "CropBox": st.builds(lambda *v: logged(_core.CropBox, *v), reals, reals),
    "CropPolygon": st.builds(lambda v: logged(_core.CropPolygon, v), corners),
    "GroundMorphological": st.builds(
        lambda v: logged(_core.GroundMorphological, **v), st.dictionaries(SIZES, real)
    ),
    "BackgroundModel": st.builds(lambda: logged(_core.BackgroundModel)),
} | {
    name: st.builds(lambda *v, name=name: logged(getattr(_core, name), *v), *[real] * count)
    for name, count in NUMBERS.items()
}


@given(positions, st.fixed_dictionaries(FILTERS))
def each_filter(points: Any, steps: dict[str, Any]) -> None:
    for step in steps.values():
        logged(_core.kept_rows, points, [step])


@given(positions, st.lists(st.one_of(*FILTERS.values()), max_size=3))
def kept_rows(points: Any, steps: list[Any]) -> None:
    result = logged(_core.kept_rows, points, steps)
    if result is not None:
        assert (np.diff(result) > 0).all()
        within(result, len(points))


@given(
    st.lists(positions, max_size=3),
    st.dictionaries(st.sampled_from(["azimuth_cell_deg", "elevation_cell_deg"]), real)
    | st.dictionaries(st.sampled_from(["range_margin_m", "height_margin_m"]), real),
    positions,
    word,
)
def learn_background(frames: list[Any], named: dict[str, float], points: Any, name: str) -> None:
    model = logged(_core.learn_background, frames, **{"azimuth_cell_deg": 5.0} | named)
    if model is not None:
        logged(_core.kept_rows, points, [model])
        logged(model.save, str(FOLDER / "saved") if name == "a" else f"{FOLDER}/{name}")


MODEL = b"infrasim-background 1\n"


@given(st.lists(few, min_size=4, max_size=4), st.binary(max_size=200), st.booleans(), positions)
def load_background(header: list[int], cells: bytes, fits: bool, points: Any) -> None:
    numbers = np.array([n % 2**32 for n in header], np.uint32).astype(np.int32)
    if fits:
        azimuth, rows = int(numbers[0]), int(numbers[3])
        size = 8 * azimuth * rows
        cells = (cells * 50 + bytes(64))[:size] if 0 <= size <= 10000 else cells
    file = FOLDER / "model"
    file.write_bytes(MODEL + numbers.tobytes() + cells)
    model = logged(_core.BackgroundModel.load, str(file))
    if model is not None:
        logged(_core.kept_rows, points, [model])


# Input files of version 0.3, whose LiDARs have keys with their earlier names.
shutil.copytree(V0_3, INPUTS)
for file in INPUTS.glob("*.yaml"):
    text = file.read_text().replace("seam_deg", "cut_angle_deg").replace("wedges", "prisms")
    file.write_text(text)
LIDARS = [_core.Lidar(str(INPUTS / f"{name}.yaml"), "datasheet") for name in ("turning", "rosette")]
SCENE = (INPUTS / "site.yaml").read_text().replace("duration_s: 150", "duration_s: 1")
WORLD = _core.World.of_text(SCENE, "site")


@given(st.sampled_from(LIDARS), st.floats() | st.just(0.3))
def law_exponent(lidar: Any, exponent: float) -> None:
    changed = logged(lidar.with_law_exponent, exponent)
    assert changed is None or changed.name == lidar.name


@given(st.sampled_from(LIDARS), st.text() | st.sampled_from(["strongest", "last", "dual"]))
def echo(lidar: Any, mode: str) -> None:
    changed = logged(lidar.with_echo, mode)
    assert changed is None or changed.name == lidar.name


@given(st.sampled_from(LIDARS), st.floats() | st.sampled_from([5.0, 20.0]))
def rate(lidar: Any, rate_hz: float) -> None:
    changed = logged(lidar.with_rate, rate_hz)
    assert changed is None or changed.period_s == 1 / rate_hz
    frames = logged(WORLD.frames_of, 1 / rate_hz if rate_hz else 0.0)
    assert frames is None or frames > 0


@given(st.sampled_from(LIDARS), few, few, few, st.none() | few, word)
def pattern(lidar: Any, first: int, last: int, step: int, seed: int | None, mount: str) -> None:
    result = logged(lidar.pattern, first, last, step, seed, mount)
    assert result is None or np.isfinite(result).all()
    logged(lidar.period_warnings, first, last, step)
    assert logged(lidar.fields_of_view)
    free = logged(logged(lidar.with_every_hit).with_free_motors)
    logged(free.pattern, first, first + 1, step, seed, mount)
    assert free.name == lidar.name
    assert free.preset == lidar.preset == "datasheet"
    assert "phase" in logged(free.dump) or "rosette" in lidar.name


@given(st.sampled_from(["turning.yaml", "site.yaml", "none.yaml", "", "\0"]), word, word)
def files(name: str, preset: str, mount: str) -> None:
    logged(_core.Lidar, str(INPUTS / name), preset)
    logged(_core.Lidar, name, preset)
    logged(_core.World, str(INPUTS / name), ["duration_s=0.1", f"seed={mount}"], preset, mount)
    logged(_core.World, mount, [preset], preset, mount)


@given(st.integers(0, len(SCENE)), st.integers(0, 40), word | st.text(max_size=5), word)
def of_text(at: int, less: int, more: str, preset: str) -> None:
    made = logged(_core.World.of_text, SCENE[:at] + more + SCENE[at + less :], "s", preset, "")
    if made is not None:
        assert made.frames > 0
        assert made.dump()
        assert made.roads_csv()


@given(few, st.sampled_from([*LIDARS, None, WORLD]), word)
def scene(frame: int, lidar: Any, preset: str) -> None:
    objects = logged(WORLD.objects, frame)
    assert (objects is not None) == (0 <= frame < WORLD.frames)
    assert objects is None or all(np.isfinite(objects[n]).all() for n in objects.dtype.names)
    assert (logged(WORLD.lidar_yaml, lidar) is not None) == (lidar in LIDARS)
    assert logged(WORLD.dump)
    assert logged(WORLD.regions_csv) == ""
    logged(WORLD.label_time, preset)
    logged(WORLD.drive)


@given(few, real, word)
def mesh(frame: int, share: float, preset: str) -> None:
    result = logged(WORLD.mesh, frame, share)
    if result is not None:
        assert np.isfinite(result[0]).all()
        within(result[1], len(result[0]))
    logged(WORLD.label_time, preset)


@given(
    st.lists(st.sampled_from(LIDARS), min_size=1, max_size=2)
    | st.lists(st.sampled_from([*LIDARS, None]), max_size=3),
    st.lists(st.integers(0, 9), min_size=1, max_size=3) | st.lists(few, max_size=4),
    st.integers(1, 3) | few,
)
def frame_stream(lidars: list[Any], frames: list[int], threads: int) -> None:
    logged(_core.warnings, WORLD, lidars)
    assert logged(_core.Frame) is None
    stream = logged(
        _core.FrameStream, WORLD, lidars, frames, min(threads, 4) if threads < 1025 else threads
    )
    assert stream is None or logged(iter, stream) is stream
    for _ in range(len(frames) + 2 if stream is not None else 0):
        result = logged(next, stream, None)
        for frame in result[1] if result is not None else ():
            columns = (frame.intensity, frame.time, frame.ring, frame.class_id, frame.object_id)
            columns += (frame.echo,)
            assert {len(column) for column in columns} == {len(frame)} == {len(frame.xyz)}
            assert frame.rays > 0
            assert frame.seconds > 0
            assert len(frame.objects.dtype.names) > 10
            del stream, result  # the columns must outlive the result
            assert np.isfinite(frame.xyz).all()
            return


OBSERVER = _core.Observer(str(INPUTS / "site.yaml"), ["duration_s=1"], "datasheet", "", [0, 5])


@given(
    st.lists(real, min_size=5, max_size=5) | st.just([-14.0, 9.5, 6.0, 0.0, 0.0]),
    st.lists(st.sampled_from([*LIDARS, None]), max_size=2),
    st.lists(st.sampled_from([0, 5]) | few, max_size=3),
    word,
)
def observer(pose: list[float], lidars: list[Any], frames: list[int], preset: str) -> None:
    fault = logged(OBSERVER.fault, pose)
    rows = logged(OBSERVER.observe, pose, lidars, frames)
    if rows is not None:
        assert fault == ""
        within(rows["lidar"], len(lidars))
        assert (rows["points"] > 0).all()
    objects = logged(OBSERVER.present, frames)
    assert (objects is not None) == (set(frames) <= {0, 5})
    logged(_core.Observer, str(INPUTS / "site.yaml"), ["duration_s=1"], preset, preset, frames)


def numbers() -> None:
    assert logged(_core.version)
    assert logged(_core.frames_version) > 0


TESTS: tuple[Callable[[], None], ...] = (
    farthest_points,
    ball_query,
    shifted_pairs,
    reached_voxels,
    suppress,
    pillar_map,
    pillar_map_that_fits,
    each_filter,
    kept_rows,
    learn_background,
    load_background,
    law_exponent,
    echo,
    rate,
    pattern,
    files,
    of_text,
    scene,
    mesh,
    frame_stream,
    observer,
    numbers,
)


def main() -> None:
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    end = time.monotonic() + SECONDS
    rules = settings(
        max_examples=EXAMPLES,
        deadline=None,
        derandomize=not SECONDS,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    tests = [function if function is numbers else rules(function) for function in TESTS]
    while True:
        for test in tests:
            test()
        if time.monotonic() >= end:
            break
    print(*CALLED)


if __name__ == "__main__":
    main()
