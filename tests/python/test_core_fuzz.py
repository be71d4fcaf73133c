"""Every call of the extension returns or raises; no arguments end the process.

The calls are those of hostile_calls.py. They run in another process, so that a crash fails the
test. The calls are always the same, except in `make fuzz`, which makes other calls for
FUZZ_SECONDS.
"""

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from core_members import members

_core = pytest.importorskip("pyinfra._core")

SECONDS = float(os.environ.get("FUZZ_SECONDS", "0"))


@pytest.mark.timeout(300 + 2 * SECONDS)
def test_hostile_arguments_are_refused_by_every_member_of_the_extension(tmp_path: Path) -> None:
    log = tmp_path / "last_call"
    script = Path(__file__).with_name("hostile_calls.py")
    words = [sys.executable, str(script), str(log), str(SECONDS)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=280 + 2 * SECONDS)
    last = log.read_bytes().decode(errors="replace")
    assert done.returncode == 0, f"exit code {done.returncode}, last call {last}\n{done.stderr}"
    assert set(done.stdout.split()) == members()


POINTS = np.ones((5, 3), np.float32)
WIDE_CELLS = _core.GroundMorphological(window_m=math.inf, cell_m=math.inf)
GRID: dict[str, tuple[int, int, int]] = {
    "shape": (4, 4, 4),
    "kernel": (3, 3, 3),
    "stride": (1, 1, 1),
    "padding": (1, 1, 1),
    "target_shape": (4, 4, 4),
}


def reached(row: tuple[int, ...] = (0, 1, 1, 1), **sizes: tuple[int, int, int]) -> object:
    return _core.reached_voxels(np.array([row], np.int64), **(GRID | sizes))


@pytest.mark.parametrize(
    ("named", "call"),
    [
        ("coordinates", lambda: reached((0, 5, 0, 0))),
        ("coordinates", lambda: reached((0, -1, 0, 0))),
        ("coordinates", lambda: reached((-1, 0, 0, 0))),
        ("coordinates", lambda: reached((2**62, 0, 0, 0))),
        ("stride, y", lambda: reached(stride=(1, 0, 1))),
        ("kernel, x", lambda: reached(kernel=(3, 3, -3))),
        ("padding, z", lambda: reached(padding=(-1, 0, 0))),
        ("batches x target_shape", lambda: reached(target_shape=(2**21, 2**21, 2**21))),
        ("shape x kernel, z", lambda: reached(shape=(2**20, 4, 4), kernel=(2**20, 1, 1))),
        ("keys", lambda: _core.shifted_pairs(np.array([3, 1], np.int64), [2])),
        ("keys", lambda: _core.shifted_pairs(np.array([[1, 2]], np.int64), [2])),
        ("limit", lambda: _core.ball_query(POINTS, POINTS, 1.0, 2**62)),
        ("centres x limit", lambda: _core.ball_query(POINTS, POINTS, 1.0, 2**28)),
        ("count", lambda: _core.farthest_points(POINTS, 2**40)),
        ("count", lambda: _core.farthest_points(POINTS, -1)),
        ("boxes", lambda: _core.suppress(np.full((2, 7), np.nan), 0.5, 5)),
        ("iou", lambda: _core.suppress(np.ones((2, 7)), math.nan, 5)),
        ("limit", lambda: _core.suppress(np.ones((2, 7)), 0.5, -1)),
        ("points", lambda: _core.kept_rows(np.broadcast_to(POINTS[:1], (2**31, 3)), [])),
        ("ground_morphological", lambda: _core.kept_rows(POINTS, [WIDE_CELLS])),
    ],
)
def test_an_argument_out_of_its_range_is_named(named: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=rf"^{named}: "):
        call()


@pytest.mark.timeout(30)
def test_a_path_does_not_end_at_a_zero_byte(tmp_path: Path) -> None:
    model = _core.learn_background([POINTS])
    model.save(str(tmp_path / "model"))
    for use in (model.save, _core.BackgroundModel.load):
        for name in ("model\0", "\0", "model\0.bin"):
            with pytest.raises(_core.IoError, match="zero byte"):
                use(str(tmp_path / name))
    assert [file.name for file in tmp_path.iterdir()] == ["model"]


def test_sums_beyond_64_bits_are_no_keys() -> None:
    keys = np.array([-(2**63), 1, 2**63 - 1], np.int64)
    inputs, outputs, counts = _core.shifted_pairs(keys, [2**62, -(2**62), 2**63 - 1, 0])
    assert counts == [0, 0, 0, 3]
    assert inputs.tolist() == outputs.tolist() == [0, 1, 2]


def test_a_window_wider_than_the_cloud_is_one_that_covers_it() -> None:
    road = np.stack([*np.meshgrid(np.arange(-10, 10), np.arange(-10, 10)), np.zeros((20, 20))], 2)
    cloud = np.concatenate([road.reshape(-1, 3), [[1, 1, 2]]]).astype(np.float32)
    kept = [
        _core.kept_rows(cloud, [_core.GroundMorphological(window_m=width)]).tolist()
        for width in (100, 1e10, 1e300)
    ]
    assert kept == [[400]] * 3
