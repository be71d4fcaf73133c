"""Several processes together learn the same weights as one process."""

import contextlib
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import road_sample  # noqa: E402
from test_training import LIDAR  # noqa: E402

from pyinfra.formats import kitti  # noqa: E402
from pyinfra.models.detectors import distributed  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]


def lidar_folder(folder: Path) -> Path:
    (folder / "ImageSets").mkdir(parents=True)
    (folder / "lidar.yaml").write_text(LIDAR)
    for frame in range(8):
        sample = road_sample(frame)
        labels = kitti.Labels(np.full(len(sample.boxes), "Car"), sample.boxes, None)
        kitti.write_frame(folder, frame, sample.points, labels)
    (folder / "ImageSets/train.txt").write_text("".join(f"{k:06d}\n" for k in range(8)))
    return folder


def free_ports(count: int) -> list[int]:
    """Returns different free ports. On a port that was used before, a new process group may find
    the old one."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [int(one.getsockname()[1]) for one in sockets]


def learn(folder: Path, out: Path, count: int) -> list[dict[str, torch.Tensor]]:
    """Returns the weights that each of `count` processes has learnt."""
    out.mkdir()
    ports = " ".join(map(str, free_ports(4)))
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    shared = {"WORLD_SIZE": str(count), "MASTER_ADDR": "127.0.0.1", "PORTS": ports}
    words = [sys.executable, str(Path(__file__).with_name("learn_together.py")), folder, out]
    started = [
        subprocess.Popen(
            words,
            env=os.environ | shared | {"RANK": str(rank), "LOCAL_RANK": str(rank)}
            | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank in range(count)
    ]  # fmt: skip
    try:
        ends = [process.communicate(timeout=500)[1] for process in started]
    finally:
        for process in started:
            process.kill()
    assert [process.returncode for process in started] == [0] * count, "".join(ends)
    return [torch.load(out / f"{rank}.pt", weights_only=True) for rank in range(count)]


@pytest.mark.nightly
@pytest.mark.timeout(1100)
def test_two_processes_learn_what_one_does_and_write_once(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path / "road/ring")
    (alone,) = learn(folder, tmp_path / "one", 1)
    first, second = learn(folder, tmp_path / "two", 2)
    assert alone.keys() == first.keys() == second.keys()
    for name, wanted in alone.items():
        torch.testing.assert_close(first[name], wanted, atol=2e-4, rtol=1e-4, msg=name)
        assert torch.equal(first[name], second[name]), name
    whole, killed = tmp_path / "two/whole", tmp_path / "two/killed"
    for name in ("last.safetensors", "best.safetensors", "validation.csv"):
        assert (whole / name).read_bytes() == (killed / name).read_bytes(), name
    for run in (whole, killed):
        steps = [row.split(",")[0] for row in (run / "log.csv").read_text().splitlines()]
        assert steps == ["step", "1", "2", "3", "4", "5"]


def test_a_batch_is_shared_evenly_and_a_device_is_not_given_by_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(distributed, "count", lambda: 3)
    distributed.check_batch(6)
    with pytest.raises(ValueError, match="batch: expected a multiple of 3, the number"):
        distributed.check_batch(4)
    monkeypatch.setenv("WORLD_SIZE", "3")
    with (
        pytest.raises(ValueError, match="expected 'cuda' without a number for several processes"),
        distributed.joined(torch.device("cuda:1")),
    ):
        pass
