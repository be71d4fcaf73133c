"""Operations of the detectors, compared with NumPy, brute force and dense convolution."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from pyinfra.core import boxes as exact
from pyinfra.core.arrays import FloatArray
from pyinfra.models.ops import boxes, clouds, points, rulebooks, sets, sparse
from pyinfra.models.ops.rulebooks import Rulebook, Triple, strided_rulebook, submanifold_rulebook
from pyinfra.models.ops.sparse import SparseConv3d, SparseTensor, SubmanifoldConv3d

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(params=["compiled", "torch"])
def either(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Runs a test with the compiled kernels, and again without them, as on systems where they are
    missing."""
    if request.param == "torch":
        without_kernels(monkeypatch)
    else:
        pytest.importorskip("pyinfra._core")
    return str(request.param)


def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (boxes, clouds, rulebooks):
        monkeypatch.setattr(module, "kernels", None)


def random_boxes(n: int, seed: int) -> Tensor:
    low, high = [-4, -4, -1, 0.5, 0.5, 1, -7], [4, 4, 1, 12, 3, 4, 7]
    return torch.from_numpy(np.random.default_rng(seed).uniform(low, high, (n, 7)))


def pairs_with_degenerate_ones(seed: int) -> tuple[Tensor, Tensor]:
    """Returns pairs of random, equal, nearly equal and rotated boxes. Some boxes lie on a grid and
    often touch."""
    random = np.random.default_rng(seed)
    a = random_boxes(6000, seed)
    b = random_boxes(6000, seed + 1)
    b[1000:2000] = a[1000:2000]
    for k, row in enumerate(range(2000, 3000, 125)):
        noise = random.uniform(-1, 1, (125, 7)) * 10.0 ** -(3 + k)
        b[row : row + 125] = a[row : row + 125] + torch.from_numpy(noise)
    b[3000:4000] = a[3000:4000]
    b[3000:4000, 6] += torch.arange(1000) % 4 * (np.pi / 2)
    for part in (a[4000:], b[4000:]):
        part.copy_((part * 2).round() / 2)
        part[:, 3:6].clamp_(min=0.5)
        part[:, 6] = (part[:, 6] / (np.pi / 4)).round() * (np.pi / 4)
    return a, b


@pytest.mark.parametrize(("dtype", "within"), [(torch.float64, 1e-10), (torch.float32, 1e-5)])
@pytest.mark.parametrize("away", [0.0, 100.0])
def test_overlap_agrees_with_the_exact_one(dtype: torch.dtype, within: float, away: float) -> None:
    shift = torch.tensor([away, -away, 0, 0, 0, 0, 0])
    a, b = (part + shift for part in pairs_with_degenerate_ones(0))
    a, b = a.to(dtype), b.to(dtype)
    one, two = a.double().numpy(), b.double().numpy()
    bev, volume = boxes.bev_iou_pairs(a, b), boxes.iou_3d_pairs(a, b)
    assert bev.dtype == volume.dtype == dtype
    assert np.abs(bev.numpy() - exact.pair_bev_iou(one, two)).max() < within
    assert np.abs(volume.numpy() - exact.pair_iou_3d(one, two)).max() < within
    best, row = boxes.best_overlap(a[:60], b[:40])
    first, second = np.repeat(one[:60], 40, axis=0), np.tile(two[:40], (60, 1))
    table = exact.pair_iou_3d(first, second).reshape(60, 40)
    assert np.abs(best.numpy() - table.max(axis=1)).max() < within
    assert np.abs(table[np.arange(60), row.numpy()] - table.max(axis=1)).max() < within


def test_boxes_that_touch_or_are_apart_overlap_by_exactly_nothing() -> None:
    a = torch.tensor([[60.0, 20, -5, 4, 2, 1.5, 0.3]]).repeat(3, 1)
    b = a.clone()
    b[0, :2] += 4 * torch.tensor([np.cos(0.3), np.sin(0.3)])
    b[1, :2] += 50
    b[2, 2] += 1.6
    assert boxes.bev_iou_pairs(a[:2], b[:2]).tolist() == [0, 0]
    assert boxes.iou_3d_pairs(a[2:], b[2:]).tolist() == [0]
    assert boxes.best_overlap(a, b[1:])[0].tolist() == [0, 0, 0]


def test_overlap_of_no_boxes_and_of_boxes_without_area() -> None:
    none, some = torch.zeros(0, 7), torch.zeros(3, 7)
    assert [part.shape for part in boxes.best_overlap(none, some)] == [(0,), (0,)]
    assert [part.tolist() for part in boxes.best_overlap(some, none)] == [[0, 0, 0]] * 2
    assert boxes.bev_iou_pairs(none, none).shape == (0,)
    assert boxes.best_overlap(some, some)[0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("measure", [boxes.bev_iou_pairs, boxes.iou_3d_pairs])
def test_gradient_of_the_overlap_is_its_slope(
    measure: Callable[[Tensor, Tensor], Tensor],
) -> None:
    a = random_boxes(12, 5).requires_grad_()
    b = random_boxes(12, 6)
    b[:, :3] = a.detach()[:, :3] + 0.3
    assert torch.autograd.gradcheck(measure, (a, b.requires_grad_()))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradient_of_the_overlap_is_finite_everywhere(dtype: torch.dtype) -> None:
    a, b = (part.to(dtype).requires_grad_() for part in pairs_with_degenerate_ones(2))
    boxes.iou_3d_pairs(a, b).sum().backward()
    for part in (a, b):
        assert part.grad is not None
        assert part.grad.isfinite().all()
        assert part.grad.abs().max() < 100


def test_descent_on_the_overlap_brings_a_box_home() -> None:
    goal = torch.tensor([[10.0, 2, -5, 4, 2, 1.5, 0.3]])
    box = (goal + torch.tensor([[0.8, -0.4, 0.2, 0.5, 0.3, -0.2, 0.4]])).requires_grad_()
    optimiser = torch.optim.Adam([box], 0.02)
    for step in range(300):
        optimiser.param_groups[0]["lr"] = 0.02 * (1 - step / 300)
        optimiser.zero_grad()
        (1 - boxes.iou_3d_pairs(box, goal)).sum().backward()
        optimiser.step()
    assert boxes.iou_3d_pairs(box, goal) > 0.98


def crowd(n: int, clusters: int, seed: int) -> tuple[Tensor, Tensor]:
    """Returns cars in dense clusters, (n, 7), and their scores. Some scores are equal."""
    random = np.random.default_rng(seed)
    at = random.integers(clusters, size=n)
    b = np.zeros((n, 7))
    b[:, :2] = random.uniform(-60, 60, (clusters, 2))[at] + random.normal(0, 0.5, (n, 2))
    b[:, 3:6] = [4.2, 1.9, 1.6] * random.uniform(0.9, 1.1, (n, 3))
    b[:, 6] = random.uniform(-3, 3, clusters)[at] + random.normal(0, 0.1, n)
    return torch.from_numpy(b), torch.from_numpy(random.integers(100, size=n) / 100)


def greedy(b: FloatArray, scores: FloatArray, iou: float, limit: int) -> list[int]:
    order = sorted(range(len(b)), key=lambda k: (-scores[k], k))
    overlap = exact.bev_iou(b, b)
    kept: list[int] = []
    for k in order:
        if all(overlap[k, other] <= iou for other in kept):
            kept.append(k)
    return kept[:limit]


@pytest.mark.parametrize("iou", [0.0, 0.1, 0.5, 0.7])
@pytest.mark.usefixtures("either")
def test_suppression_is_the_greedy_one(iou: float) -> None:
    for seed, n in enumerate([1, 2, 50, 400]):
        b, scores = crowd(n, 20, seed)
        wanted = greedy(b.numpy(), scores.numpy(), iou, n)
        assert boxes.nms(b, scores, iou, n).tolist() == wanted
        assert boxes.nms(b, scores, iou, 7).tolist() == wanted[:7]


@pytest.mark.usefixtures("either")
def test_suppression_of_equal_boxes_and_scores_keeps_the_first() -> None:
    b = torch.tensor([[10.0, 2, -5, 4, 2, 1.5, 0.3]]).repeat(5, 1)
    assert boxes.nms(b, torch.ones(5), 0.5, 10).tolist() == [0]
    assert boxes.nms(b, torch.ones(5), 1.0, 10).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.usefixtures("either")
def test_suppression_of_nothing_and_to_nothing() -> None:
    assert boxes.nms(torch.zeros(0, 7), torch.zeros(0), 0.5, 10).shape == (0,)
    assert boxes.nms(random_boxes(5, 0), torch.ones(5), 0.5, 0).tolist() == []


@needs_gpu
def test_boxes_on_a_gpu_are_as_on_the_cpu() -> None:
    a, b = pairs_with_degenerate_ones(3)
    bev = boxes.bev_iou_pairs(a.cuda(), b.cuda()).cpu()
    assert (bev - boxes.bev_iou_pairs(a, b)).abs().max() < 1e-10
    b, scores = crowd(400, 20, 0)
    on_gpu = boxes.nms(b.cuda(), scores.cuda(), 0.3, 100)
    assert on_gpu.is_cuda
    assert on_gpu.tolist() == boxes.nms(b, scores, 0.3, 100).tolist()


SHAPE = (7, 12, 9)


def voxels(n: int, channels: int, seed: int, dtype: torch.dtype = torch.float64) -> SparseTensor:
    """Returns random voxels of a batch of 3, in random order. The last frame of the batch is
    empty."""
    random = np.random.default_rng(seed)
    chosen = random.choice(2 * int(np.prod(SHAPE)), n, replace=False)
    at = np.stack(np.unravel_index(chosen, (2, *SHAPE)), 1).reshape(n, 4)
    features = torch.from_numpy(random.normal(size=(n, channels))).to(dtype)
    return SparseTensor(features, torch.from_numpy(at), SHAPE, 3)


def grid(x: SparseTensor) -> Tensor:
    """Returns the dense grid: (B, C, D, H, W)."""
    return x.to_dense().reshape(x.batch_size, -1, *x.shape)


def dense_weight(layer: SubmanifoldConv3d | SparseConv3d) -> Tensor:
    _, channels_in, channels_out = layer.weight.shape
    return layer.weight.reshape(*layer.kernel, channels_in, channels_out).permute(4, 3, 0, 1, 2)


def at_voxels(dense: Tensor, coordinates: Tensor) -> Tensor:
    """Returns the values (m, C) of a dense grid (B, C, D, H, W) at coordinates (m, 4)."""
    batch, z, y, x = coordinates.unbind(1)
    return dense[batch, :, z, y, x]


def assert_same_with_gradients(sparse_out: Tensor, dense_out: Tensor, inputs: list[Tensor]) -> None:
    weights = torch.linspace(-1, 1, sparse_out.numel(), dtype=sparse_out.dtype)
    weights = weights.reshape(sparse_out.shape)
    assert (sparse_out - dense_out).abs().max() < 1e-12
    ours = torch.autograd.grad((sparse_out * weights).sum(), inputs, retain_graph=True)
    theirs = torch.autograd.grad((dense_out * weights).sum(), inputs)
    for one, two in zip(ours, theirs, strict=True):
        assert (one - two).abs().max() < 1e-12


def test_dense_form_has_the_features_where_the_voxels_are() -> None:
    x = voxels(100, 2, 0)
    dense = x.to_dense()
    assert dense.shape == (3, 2 * SHAPE[0], SHAPE[1], SHAPE[2])
    assert (at_voxels(grid(x), x.coordinates) == x.features).all()
    assert dense.count_nonzero() == x.features.numel()


@pytest.mark.parametrize("kernel", [(3, 3, 3), (3, 1, 1), (1, 3, 5), (1, 1, 1)])
@pytest.mark.parametrize("n", [1, 40, 700])
@pytest.mark.usefixtures("either")
def test_submanifold_convolution_is_the_dense_one_at_its_voxels(kernel: Triple, n: int) -> None:
    x = voxels(n, 4, n)
    x.features.requires_grad_()
    layer = SubmanifoldConv3d(4, 5, "a", kernel, bias=True).double()
    out = layer(x)
    padding = tuple(size // 2 for size in layer.kernel)
    dense = torch.conv3d(grid(x), dense_weight(layer), layer.bias, padding=padding)
    assert out.coordinates is x.coordinates
    assert layer.bias is not None
    assert_same_with_gradients(
        out.features, at_voxels(dense, x.coordinates), [x.features, layer.weight, layer.bias]
    )


@pytest.mark.parametrize(
    ("kernel", "stride", "padding"),
    [
        ((3, 3, 3), (2, 2, 2), (1, 1, 1)),
        ((3, 3, 3), (1, 2, 2), (0, 1, 1)),
        ((3, 1, 1), (2, 1, 1), (0, 0, 0)),
        ((2, 2, 2), (2, 2, 2), (0, 0, 0)),
        ((3, 3, 3), (1, 1, 1), (1, 1, 1)),
        ((2, 3, 5), (3, 2, 1), (1, 0, 2)),
    ],
)
@pytest.mark.parametrize("n", [1, 40, 700])
@pytest.mark.usefixtures("either")
def test_strided_convolution_is_the_dense_one(
    kernel: Triple,
    stride: Triple,
    padding: Triple,
    n: int,
) -> None:
    x = voxels(n, 4, n)
    x.features.requires_grad_()
    layer = SparseConv3d(4, 5, "a", kernel, stride, padding).double()
    out = layer(x)
    dense = torch.conv3d(grid(x), dense_weight(layer), None, layer.stride, layer.padding)
    assert out.shape == dense.shape[2:]
    assert_same_with_gradients(grid(out), dense, [x.features, layer.weight])
    keys = (out.coordinates * torch.tensor([10**6, 10**4, 10**2, 1])).sum(1)
    assert (keys.diff() > 0).all()


@pytest.mark.usefixtures("either")
def test_sparse_convolution_has_the_gradient_of_its_slope() -> None:
    x = voxels(30, 2, 1)
    weight = torch.randn(27, 2, 3, dtype=torch.float64, requires_grad=True)
    for rulebook in (
        submanifold_rulebook(x.coordinates, SHAPE, (3, 3, 3)),
        strided_rulebook(x.coordinates, SHAPE, (3, 3, 3), (2, 2, 2), (1, 1, 1)),
    ):
        assert torch.autograd.gradcheck(
            lambda f, w, rulebook=rulebook: sparse.convolve(f, w, rulebook),
            (x.features.requires_grad_(), weight),
        )


def test_layers_with_one_key_share_a_rulebook() -> None:
    x = voxels(100, 4, 0)
    y = SubmanifoldConv3d(4, 4, "a").double()(x)
    first = x.rulebooks["a"]
    y = SubmanifoldConv3d(4, 8, "a").double()(y)
    assert y.rulebooks["a"] is first
    assert y.features.shape == (100, 8)


@pytest.mark.usefixtures("either")
def test_sparse_layers_take_no_voxels() -> None:
    x = voxels(0, 4, 0, torch.float32)
    x.features.requires_grad_()
    y = SubmanifoldConv3d(4, 4, "a")(x)
    z = SparseConv3d(4, 4, "b")(y)
    assert len(y.features) == len(z.features) == 0
    assert z.to_dense().shape == (3, 4 * 4, 6, 5)
    z.features.sum().backward()


def test_sparse_convolution_under_autocast_is_in_half_precision() -> None:
    x = voxels(300, 16, 0, torch.float32)
    layer = SubmanifoldConv3d(16, 16, "a")
    with torch.autocast("cpu", torch.bfloat16):
        out = layer(x).features
    assert out.dtype == torch.bfloat16
    assert (out - layer(x).features).abs().max() < 0.05
    out.sum().backward()
    assert layer.weight.grad is not None
    assert layer.weight.grad.dtype == torch.float32


@needs_gpu
def test_sparse_convolution_on_a_gpu_is_as_on_the_cpu() -> None:
    x = voxels(700, 8, 0)
    on_gpu = SparseTensor(x.features.cuda(), x.coordinates.cuda(), x.shape, x.batch_size)
    first, second = SubmanifoldConv3d(8, 8, "a").double(), SparseConv3d(8, 8, "b").double()
    here = second(first(x)).to_dense()
    there = second.cuda()(first.cuda()(on_gpu)).to_dense()
    assert (here - there.cpu()).abs().max() < 1e-12


@needs_gpu
def test_gradients_of_sparse_convolutions_on_a_gpu_are_those_of_the_cpu() -> None:
    down, same = SparseConv3d(8, 8, "a").double(), SubmanifoldConv3d(8, 4, "b").double()
    gradients = {}
    for device in ("cpu", "cuda"):
        x = voxels(700, 8, 0)
        features = x.features.to(device).requires_grad_()
        at = SparseTensor(features, x.coordinates.to(device), x.shape, x.batch_size)
        out = same.to(device)(down.to(device)(at)).features
        weights = torch.linspace(-1, 1, out.numel(), dtype=out.dtype, device=device)
        inputs = [features, down.weight, same.weight]
        gradients[device] = torch.autograd.grad((out.flatten() * weights).sum(), inputs)
    for here, there in zip(gradients["cpu"], gradients["cuda"], strict=True):
        assert (here - there.cpu()).abs().max() < 1e-10


def cloud(n: int, seed: int, step: float = 0.0) -> Tensor:
    """Returns points (n, 3) of a wide and flat scene. With a step, points lie on a grid, so that
    many are equal."""
    xyz = np.random.default_rng(seed).uniform([0, -20, -6], [60, 20, -3], (n, 3))
    return torch.from_numpy(np.round(xyz / step) * step if step else xyz).float()


@pytest.mark.usefixtures("either")
@pytest.mark.parametrize("step", [0.0, 2.0])
def test_farthest_points_are_each_the_farthest_from_those_before(step: float) -> None:
    xyz = cloud(500, 0, step)
    rows, _ = clouds.farthest_of_clouds(xyz, [500], 60)
    distances = torch.cdist(xyz.double(), xyz.double())
    assert rows[0] == 0
    for k in range(1, 60):
        apart = distances[:, rows[:k]].amin(1)
        assert apart[rows[k]] > apart.max() - 1e-5


@pytest.mark.usefixtures("either")
def test_farthest_points_of_fewer_points_than_asked_for_are_all_points() -> None:
    xyz = torch.tensor([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [1, 0, 0]])

    def chosen(count: int, most: int) -> list[int]:
        rows: list[int] = clouds.farthest_of_clouds(xyz[:count], [count], most)[0].tolist()
        return rows

    assert chosen(4, 3) == [0, 2, 1]
    assert chosen(4, 6) == [0, 1, 2, 3]
    assert chosen(1, 3) == [0]
    assert chosen(4, 0) == []
    assert chosen(0, 3) == []


@pytest.mark.usefixtures("either")
@pytest.mark.parametrize("radius", [0.3, 2.0, 500.0])
@pytest.mark.parametrize("step", [0.0, 0.5])
def test_ball_query_finds_the_first_points_of_each_ball(radius: float, step: float) -> None:
    xyz, centres = cloud(800, 1, step), cloud(90, 2, step)
    rows, owners = clouds.neighbours(xyz, [800], centres, [90], radius, 8)
    near = torch.cdist(centres.double(), xyz.double()) < radius
    assert (owners.diff() >= 0).all()
    for k, ball in enumerate(near):
        assert rows[owners == k].tolist() == torch.nonzero(ball).flatten().tolist()[:8]


@pytest.mark.usefixtures("either")
def test_ball_query_takes_fewer_points_than_asked_for_and_none() -> None:
    xyz = cloud(3, 0, 1.0)
    rows, owners = clouds.neighbours(xyz, [3], xyz, [3], 100, 5)
    assert rows.tolist() == [0, 1, 2] * 3
    assert owners.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    for points_of, centres_of in ((0, 3), (3, 0)):
        rows, owners = clouds.neighbours(
            xyz[:points_of], [points_of], xyz[:centres_of], [centres_of], 100, 5
        )
        assert rows.shape == owners.shape == (0,)


def test_compiled_kernels_and_torch_choose_the_same_points(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyinfra._core")
    parts = [cloud(n, n, step) for n in (1, 70, 3000) for step in (0.0, 1.0)]
    xyz, counts = torch.cat(parts), [len(part) for part in parts]
    centres, of_centres = torch.cat([p[::3] for p in parts]), [len(p[::3]) for p in parts]

    def chosen() -> list[Tensor]:
        rows, _ = clouds.farthest_of_clouds(xyz, counts, 200)
        return [rows, *clouds.neighbours(xyz, counts, centres, of_centres, 1.0, 16)]

    compiled = chosen()
    without_kernels(monkeypatch)
    for one, two in zip(compiled, chosen(), strict=True):
        assert one.tolist() == two.tolist()


def test_compiled_kernels_and_torch_make_the_same_rulebooks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("pyinfra._core")
    at = voxels(500, 1, 0).coordinates.unique(dim=0)  # ascending, as in a voxel backbone

    def rulebooks() -> list[Rulebook]:
        return [
            submanifold_rulebook(at, SHAPE, (3, 3, 3)),
            strided_rulebook(at, SHAPE, (3, 3, 3), (2, 2, 2), (1, 1, 1)),
            strided_rulebook(at, SHAPE, (3, 1, 1), (2, 1, 1), (0, 0, 0)),
        ]

    compiled = rulebooks()
    without_kernels(monkeypatch)
    for one, two in zip(compiled, rulebooks(), strict=True):
        assert one.counts == two.counts
        for name in ("inputs", "outputs", "target"):
            assert (getattr(one, name) == getattr(two, name)).all()


@pytest.fixture(params=["one by one", "together"])
def one_by_one_or_together(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs a test with the code for clouds on a CPU, and again with the code for a GPU."""
    if request.param == "together":
        monkeypatch.setattr(clouds, "on_cpu", lambda _: False)


@pytest.mark.usefixtures("one_by_one_or_together")
def test_three_nearest_are_the_nearest() -> None:
    xyz, known = cloud(200, 0), cloud(50, 1)
    wanted, nearest = torch.cdist(xyz.double(), known.double()).topk(3, largest=False)
    distances, rows = clouds.nearest_of_clouds(xyz, [200], known, [50])
    assert rows.tolist() == nearest.tolist()
    assert (distances - wanted).abs().max() < 1e-5


@pytest.mark.usefixtures("one_by_one_or_together")
def test_three_nearest_of_fewer_lack_the_others() -> None:
    xyz = cloud(4, 0)
    distances, rows = clouds.nearest_of_clouds(xyz, [4], xyz[:2], [2])
    assert rows[0].tolist() == [0, 1, 0]
    assert distances[:, 2].isinf().all()
    assert clouds.nearest_of_clouds(xyz[:0], [0], xyz, [4])[1].shape == (0, 3)
    features = torch.tensor([[1.0, 0], [0, 1]])
    between = points.interpolate(features, distances, rows)
    assert between[:2].allclose(features, atol=1e-6)
    assert between.sum(1).allclose(torch.ones(4))


def test_points_are_in_boxes_up_to_the_surface() -> None:
    box = torch.tensor([[10.0, 2, -5, 4, 2, 1.5, 0], [10, 2, -5, 8, 8, 8, 0.5]])
    xyz = torch.tensor([[12.0, 2, -5], [12.1, 2, -5], [10, 3, -4.25], [10, 2, -4.2], [30, 0, 0]])
    inside = points.points_in_boxes(xyz, box)
    assert inside.tolist() == [
        [True, True], [False, True], [True, True], [False, True], [False, False],
    ]  # fmt: skip
    assert points.box_of_points(xyz, box).tolist() == [0, 1, 0, 1, -1]
    assert points.box_of_points(xyz, box[:0]).tolist() == [-1] * 5
    assert points.box_of_points(xyz[:0], box).tolist() == []


def test_points_in_a_turned_box_are_those_in_it_when_all_is_turned_back() -> None:
    xyz, box = cloud(5000, 3), random_boxes(20, 3).float()
    box[:, :3] += torch.tensor([30.0, 0, -4.5])
    box[:, 3:6] *= 2
    inside = points.points_in_boxes(xyz, box)
    for k, (x, y, z, dx, dy, dz, heading) in enumerate(box.double().tolist()):
        turned = (xyz[:, 0] - x + 1j * (xyz[:, 1] - y)) * np.exp(-1j * heading)
        offset = torch.stack([turned.real / dx, turned.imag / dy, (xyz[:, 2] - z) / dz])
        assert (inside[:, k] == (offset.abs() <= 0.5).all(0)).all()
    assert inside.any()


@needs_gpu
def test_points_on_a_gpu_are_as_on_the_cpu() -> None:
    xyz, centres = cloud(3000, 0), cloud(200, 1)
    results = []
    for device in ("cpu", "cuda"):
        there, other = xyz.to(device), centres.to(device)
        rows, _ = clouds.farthest_of_clouds(there, [3000], 100)
        near = clouds.neighbours(there, [3000], other, [200], 1.0, 8)
        results.append([rows, *near, *clouds.nearest_of_clouds(other, [200], there, [3000])])
    for one, two in zip(*results, strict=True):
        assert one.allclose(two.cpu())


@needs_gpu
def test_features_boxes_and_sets_on_a_gpu_are_as_on_the_cpu() -> None:
    xyz, centres, features = cloud(3000, 0), cloud(200, 1), torch.randn(3000, 4)
    b = random_boxes(30, 3).float()
    b[:, :3] += torch.tensor([30.0, 0, -4.5])
    frame, row, column = torch.randint(0, 40, (3, 2000), generator=torch.manual_seed(1)).unique(
        dim=1
    )
    results = []
    for device in ("cpu", "cuda"):
        x, c, f = xyz.to(device), centres.to(device), features.to(device)
        windows = sets.windows_of(frame.to(device), row.to(device), column.to(device), 12, 6)
        parts = sets.partition(windows, windows.by_row, 36)
        results.append(
            [
                points.interpolate(f, *clouds.nearest_of_clouds(c, [200], x, [3000])),
                points.points_in_boxes(x, b.to(device)).float(),
                points.box_of_points(x, b.to(device)),
                parts.voxel,
                parts.repeats.float(),
                parts.slot,
            ]
        )
    for here, there in zip(*results, strict=True):
        assert there.is_cuda
        torch.testing.assert_close(here, there.cpu(), atol=1e-4, rtol=1e-4)
