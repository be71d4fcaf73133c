"""Batches are the same from a thread and from any number of worker processes."""

import copy
import dataclasses
import pickle
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import SITE, road_sample  # noqa: E402

from pyinfra.core.arrays import Points  # noqa: E402
from pyinfra.models.detectors.batch import Batch, Windows, make_batch  # noqa: E402
from pyinfra.models.detectors.network import Network  # noqa: E402
from pyinfra.models.training import batches, checkpoint, kept_frames, loop  # noqa: E402
from pyinfra.models.training.kept_frames import kept  # noqa: E402
from pyinfra.models.training.recipe import Recipe, read_recipe  # noqa: E402
from pyinfra.models.training.samples import Augmentation, Frames  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = [road_sample(seed) for seed in range(6)]
STEPS = 5
CPU = torch.device("cpu")


def cloud_of(i: int) -> Points:
    return SAMPLES[i].points


def frames() -> Frames:
    readers = tuple(partial(cloud_of, i) for i in range(len(SAMPLES)))
    return Frames(readers, tuple(s.boxes for s in SAMPLES))


def recipe(steps: int = STEPS) -> Recipe:
    plain = read_recipe(ROOT / "configs/detectors/centerpoint-pillar.yaml", "smoke")
    learning = dataclasses.replace(plain.learning, steps=steps, window_m2=200.0)
    augmentation = Augmentation(flip=True, rotation_deg=5, scale=0.05, pasted=4)
    return dataclasses.replace(plain, learning=learning, augmentation=augmentation)


def network() -> Network:
    torch.manual_seed(1)
    return checkpoint.build("centerpoint-pillar", recipe().network, SITE)


def assert_same(one: Batch, two: Batch) -> None:
    assert one.counts == two.counts
    assert one.windows == two.windows
    assert one.balance == two.balance
    assert len(one.boxes) == len(two.boxes)
    for a, b in zip(
        (one.points, one.frame, *one.boxes, *one.classes),
        (two.points, two.frame, *two.boxes, *two.classes),
        strict=True,
    ):
        assert torch.equal(a, b)


@pytest.mark.parametrize("in_memory", [False, True])
@pytest.mark.parametrize("workers", [0, 1, 2])
def test_batches_do_not_depend_on_the_number_of_workers(workers: int, in_memory: bool) -> None:
    expected = [loop.batch_of(frames(), recipe(), network(), 1, step) for step in range(STEPS)]
    pace = loop.Pace(workers=workers, in_memory=in_memory)
    with closing(loop.batches_of(frames(), recipe(), network(), 1, 2, pace, CPU)) as made:
        came = list(made)
    assert [step for step, _ in came] == [2, 3, 4]
    for step, batch in came:
        assert_same(batch, expected[step])


@pytest.mark.parametrize("together", [1, 3])
def test_workers_name_the_step_that_fails(together: int) -> None:
    def make(step: int) -> Batch:
        if step == 4:
            raise OSError("no frame 4")
        return make_batch([road_sample(step)], SITE.area)

    made = batches.from_workers(make, range(1, 8), 2, together=together)
    with closing(made):
        assert [next(made)[0] for _ in range(3)] == [1, 2, 3]
        with pytest.raises(OSError, match=r"^no frame 4$"):
            next(made)


def test_workers_of_no_steps_make_nothing() -> None:
    assert list(batches.from_workers(cloud_of, range(3, 3), 2)) == []  # type: ignore[arg-type]


def test_a_batch_survives_pickling_and_copying() -> None:
    batch = make_batch([road_sample(1), road_sample(2)], SITE.area)
    batch = dataclasses.replace(
        batch, balance=0.5, windows=Windows(100.0, ((1.0, 2.0), (3.0, 4.0)))
    )
    for again in (pickle.loads(pickle.dumps(batch)), copy.copy(batch), batch.to(CPU)):
        assert_same(again, batch)


def test_frames_are_read_once_and_bring_the_points_of_their_objects() -> None:
    reads = []

    def read(i: int) -> Points:
        reads.append(i)
        return cloud_of(i)

    readers = tuple(partial(read, i) for i in range(len(SAMPLES)))
    plain = Frames(readers, tuple(s.boxes for s in SAMPLES))
    in_memory = kept(plain, pasted=True)
    reads.clear()
    for i, sample in enumerate(SAMPLES):
        np.testing.assert_array_equal(in_memory.sample(i).points, sample.points)
        other = in_memory.another(i, np.random.default_rng(i))
        same = plain.another(i, np.random.default_rng(i))
        for k in range(len(same.boxes)):
            np.testing.assert_array_equal(other.points_of(k), same.points_of(k))
    assert len(reads) == len(SAMPLES)  # those of the frames that are not in memory


def test_frames_that_do_not_fit_into_memory_are_read_when_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kept_frames, "memory", lambda: 1000.0)
    plain = frames()
    assert kept(plain, pasted=True) is plain
    assert kept_frames.objects_of(SAMPLES[0].points, np.empty((0, 7))) == ()


@pytest.mark.parametrize("every", [1, 3, 100])
def test_losses_are_reported_for_each_step_however_rarely_they_are_read(
    every: int, tmp_path: Path
) -> None:
    described = provenance()
    reported = []
    pace = loop.Pace(reads_every=every)
    trained = network()
    loop.train(trained, frames(), recipe(), described, tmp_path, report=reported.append, pace=pace)
    assert [progress.step for progress in reported] == [1, 2, 3, 4, 5]
    plain = network()
    reference: list[loop.Progress] = []
    loop.train(plain, frames(), recipe(), described, tmp_path, report=reference.append)
    assert [p.loss for p in reported] == [p.loss for p in reference]
    for one, two in zip(trained.parameters(), plain.parameters(), strict=True):
        assert torch.equal(one, two)


def test_a_loss_that_is_no_number_is_named_by_its_step_even_if_it_is_read_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = loop.set_rate

    def explodes(optimizer: torch.optim.Optimizer, learning: object, step: int) -> float:
        rate = real(optimizer, learning, step)  # type: ignore[arg-type]
        for group in optimizer.param_groups:
            group["lr"] = float("inf") if step == 20 else rate
        return rate

    monkeypatch.setattr(loop, "set_rate", explodes)
    pace = loop.Pace(reads_every=50)
    with pytest.raises(loop.TrainingDiverged, match="step 21: the loss is nan"):
        loop.train(network(), frames(), recipe(41), provenance(), tmp_path, pace=pace)
    saved = checkpoint.load(tmp_path / "last.safetensors")
    assert saved.provenance.step == 20
    assert all(t.isfinite().all() for t in saved.weights().values())


def provenance() -> checkpoint.Provenance:
    names = dict.fromkeys(("lidar", "preset", "scene"), "test")
    return checkpoint.Provenance(
        "centerpoint-pillar", {}, SITE, **names, seed=1, step=0, steps=STEPS
    )
