"""Networks compute losses and boxes on the device of their batch, without a wait for the CPU.

No GPU is needed: the code for tensors on a GPU runs on the CPU, and every call that would move a
tensor between the devices or read a value of it is an error.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import SITE, road_sample  # noqa: E402
from torch import Tensor  # noqa: E402
from torch.overrides import TorchFunctionMode  # noqa: E402

from pyinfra.models.detectors import pointnet  # noqa: E402
from pyinfra.models.detectors.batch import Batch, Windows, make_batch  # noqa: E402
from pyinfra.models.detectors.catalogue import DETECTORS  # noqa: E402
from pyinfra.models.detectors.network import Network, one_thread  # noqa: E402
from pyinfra.models.ops import boxes, clouds, points, rulebooks, triton_kernels  # noqa: E402
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
ROOT = Path(__file__).resolve().parents[2]
LEARNT = [name for name, entry in DETECTORS.items() if entry.learnt]
MOVED = {"cpu", "cuda", "numpy", "tolist", "item", "__array__"}
READ = {"__bool__", "__int__", "__float__", "__index__", "__contains__"}
COPIED = {"tensor", "new_tensor", "as_tensor", "asarray", "from_numpy"}
FORBIDDEN = MOVED | READ | COPIED


class NothingMoves(TorchFunctionMode):
    """Makes it an error to move a tensor to another device, or to read its values."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        name, kwargs = getattr(func, "__name__", ""), kwargs or {}
        to_a_device = any(isinstance(a, torch.device) for a in (*args, kwargs.get("device")))
        if name in FORBIDDEN or (name == "to" and to_a_device):
            raise AssertionError(f"{name}: expected tensors that stay on their device")
        return func(*args, **kwargs)


@pytest.fixture
def as_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (boxes, clouds, points, rulebooks, pointnet):
        monkeypatch.setattr(module, "on_cpu", lambda _: False)


def network_of(name: str) -> Network:
    recipe = read_recipe(ROOT / f"configs/detectors/{name}.yaml", "smoke")
    torch.manual_seed(1)
    return checkpoint.build(name, recipe.network, SITE)


def batch_of(network: Network, *, windows: bool = False) -> Batch:
    batch = make_batch([road_sample(1), road_sample(2)], network.site.area)
    if not windows:
        return batch
    centres = tuple((float(b[0, 0]), float(b[0, 1])) for b in batch.boxes)
    return dataclasses.replace(batch, windows=Windows(300.0, centres))


@pytest.mark.usefixtures("as_on_a_gpu")
@pytest.mark.parametrize("windows", [False, True])
@pytest.mark.parametrize("name", LEARNT)
def test_losses_and_boxes_move_and_read_no_tensor(name: str, windows: bool) -> None:
    network = network_of(name).train()
    batch = batch_of(network, windows=windows and network.learns_in_windows)
    with one_thread():
        network.losses(batch)  # copies the constants, which are kept
        with NothingMoves():
            losses = network.losses(batch)
        assert torch.isfinite(torch.stack(list(losses.values()))).all()
        network.eval()
        with torch.inference_mode():
            network.candidates(batch)
            with NothingMoves():
                found = network.candidates(batch)
    assert all(len(frame[0]) for frame in found)


@pytest.mark.parametrize(
    "read", [Tensor.cpu, Tensor.numpy, Tensor.tolist, Tensor.max, bool, lambda x: x.to(x.device)]
)
def test_a_move_or_a_read_would_be_noticed(read: Callable[[Tensor], object]) -> None:
    x = torch.ones(1)
    with NothingMoves():
        if read is Tensor.max:
            read(x)
            return
        with pytest.raises(AssertionError, match="expected tensors that stay on their device"):
            read(x)


@pytest.mark.parametrize("name", LEARNT)
def test_the_code_for_a_gpu_gives_the_losses_of_the_cpu(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def losses() -> dict[str, Tensor]:
        # The order of points in full balls is another one on a GPU, so no ball is full.
        network = network_of(name).eval()
        for module in network.modules():
            if isinstance(module, pointnet.SetAbstraction):
                module.balls = tuple(dataclasses.replace(b, most=4096) for b in module.balls)
        with one_thread(), torch.no_grad():
            return network.losses(batch_of(network))

    here = losses()
    for module in (boxes, clouds, points, rulebooks, pointnet):
        monkeypatch.setattr(module, "on_cpu", lambda _: False)
    there = losses()
    for term, value in here.items():
        torch.testing.assert_close(there[term], value, atol=1e-4, rtol=1e-4)


def some_clouds(counts: Sequence[int], seed: int) -> Tensor:
    xyz = torch.rand(sum(counts), 3, generator=torch.Generator().manual_seed(seed))
    return xyz * torch.tensor([20.0, 20, 3])


@pytest.mark.parametrize(
    ("counts", "of_others"),
    [
        ([900, 0, 5, 1, 300], [70, 3, 2, 1, 20]),
        ([40], [1]),
        ([0, 0], [0, 2]),
        ([0, 30, 0], [0, 30, 0]),
    ],
)
@pytest.mark.parametrize("known", [True, False])
def test_searches_in_a_batch_of_clouds_are_those_in_each_cloud(
    counts: list[int], of_others: list[int], known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    xyz, others = some_clouds(counts, 1), some_clouds(of_others, 2)
    sizes, other_sizes = (c if known else torch.tensor(c) for c in (counts, of_others))

    def results() -> list[Tensor]:
        chosen, numbers = zip(
            *(clouds.farthest_of_clouds(xyz, sizes, most) for most in (1, 4, 100)), strict=True
        )
        near = [
            pair
            for radius, most in ((1.0, 4), (3.0, 16), (50.0, 2))
            for pair in clouds.neighbours(xyz, sizes, others, other_sizes, radius, most)
        ]
        distances, rows = clouds.nearest_of_clouds(others, other_sizes, xyz, sizes)
        apart = (others[:, None] - xyz[rows]).norm(dim=2) if len(xyz) else distances
        there = torch.isfinite(distances)
        torch.testing.assert_close(apart[there], distances[there], atol=1e-4, rtol=0)
        return [*chosen, *map(torch.as_tensor, numbers), *near, distances]

    if any(other > 0 and count == 0 for count, other in zip(counts, of_others, strict=True)):
        of_others = [min(pair) for pair in zip(counts, of_others, strict=True)]
        others, other_sizes = some_clouds(of_others, 2), of_others
    one_by_one = results()
    for module in (clouds, points):
        monkeypatch.setattr(module, "on_cpu", lambda _: False)
    for small in (False, True):  # small: the distances do not fit into memory together
        if small:
            monkeypatch.setattr(points, "_CHUNK_ON_GPU", 50)
        for one, two in zip(one_by_one, results(), strict=True):
            torch.testing.assert_close(two, one, atol=1e-4, rtol=0)


def test_a_random_order_keeps_the_points_of_each_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pointnet, "on_cpu", lambda _: False)
    xyz = some_clouds([60, 0, 40], 1)
    shuffled = pointnet.shuffled(pointnet.Clouds(xyz, xyz[:, :1], [60, 0, 40]))
    for part in (slice(0, 60), slice(60, 100)):
        moved = (shuffled.xyz[part] != xyz[part]).any(1)
        assert moved.float().mean() > 0.9
        assert torch.equal(shuffled.xyz[part].sort(0).values, xyz[part].sort(0).values)
    assert torch.equal(shuffled.xyz[:, :1], shuffled.features)


@needs_gpu
@pytest.mark.parametrize("kernels", [False, True])
def test_searches_of_clouds_on_a_gpu_are_those_of_the_cpu(
    kernels: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(triton_kernels, "enabled", kernels)
    counts, of_centres = [20_000, 0, 700, 3], [500, 0, 20, 3]
    xyz, centres = some_clouds(counts, 1), some_clouds(of_centres, 2)
    results = []
    for device in ("cpu", "cuda"):
        here, middles = xyz.to(device), centres.to(device)
        rows, _ = clouds.farthest_of_clouds(here, counts, 600)
        near = clouds.neighbours(here, counts, middles, of_centres, 0.8, 16)
        distances, _ = clouds.nearest_of_clouds(middles, of_centres, here, counts)
        results.append((rows, *near, distances))
    for one, two in zip(*results, strict=True):
        assert two.is_cuda
        torch.testing.assert_close(two.cpu(), one, atol=1e-4, rtol=0)


@needs_gpu
@pytest.mark.parametrize("name", LEARNT)
def test_a_step_reads_no_tensor_from_a_gpu(name: str) -> None:
    network = network_of(name).train().to("cuda")
    batch = batch_of(network).to(torch.device("cuda"))
    network.losses(batch)
    with NothingMoves():
        losses = network.losses(batch)
    assert all(loss.is_cuda and loss.isfinite() for loss in losses.values())
