"""Operations of the detectors, against NumPy, brute force and dense convolution."""

import numpy as np
import numpy.typing as npt
import pytest
import torch
from torch import Tensor

from pyinfra import boxes as exact
from pyinfra.detectors.ops import boxes

FloatArray = npt.NDArray[np.float64]

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def random_boxes(n: int, seed: int) -> Tensor:
    low, high = [-4, -4, -1, 0.5, 0.5, 1, -7], [4, 4, 1, 12, 3, 4, 7]
    return torch.from_numpy(np.random.default_rng(seed).uniform(low, high, (n, 7)))


def pairs_with_degenerate_ones(seed: int) -> tuple[Tensor, Tensor]:
    """Random, equal, nearly equal and turned pairs, and pairs on a grid, which often touch."""
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
    table = boxes.bev_iou(a[:60], b[:40])
    assert np.abs(table.numpy() - exact.bev_iou(one[:60], two[:40])).max() < within


def test_boxes_that_touch_or_are_apart_overlap_by_exactly_nothing() -> None:
    a = torch.tensor([[60.0, 20, -5, 4, 2, 1.5, 0.3]]).repeat(3, 1)
    b = a.clone()
    b[0, :2] += 4 * torch.tensor([np.cos(0.3), np.sin(0.3)])
    b[1, :2] += 50
    b[2, 2] += 1.6
    assert boxes.bev_iou_pairs(a[:2], b[:2]).tolist() == [0, 0]
    assert boxes.iou_3d_pairs(a[2:], b[2:]).tolist() == [0]
    assert boxes.bev_iou(a, b)[0, 1] == 0


def test_overlap_of_no_boxes_and_of_boxes_without_area() -> None:
    none, some = torch.zeros(0, 7), torch.zeros(3, 7)
    assert boxes.bev_iou(none, some).shape == (0, 3)
    assert boxes.bev_iou(some, none).shape == (3, 0)
    assert boxes.bev_iou_pairs(none, none).shape == (0,)
    assert boxes.bev_iou(some, some).tolist() == torch.zeros(3, 3).tolist()


@pytest.mark.parametrize("measure", [boxes.bev_iou_pairs, boxes.iou_3d_pairs, boxes.bev_iou])
def test_gradient_of_the_overlap_is_its_slope(measure) -> None:
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


def crowd(n: int, places: int, seed: int) -> tuple[Tensor, Tensor]:
    """Boxes (n, 7) of cars in heaps and their scores, with ties."""
    random = np.random.default_rng(seed)
    at = random.integers(places, size=n)
    b = np.zeros((n, 7))
    b[:, :2] = random.uniform(-60, 60, (places, 2))[at] + random.normal(0, 0.5, (n, 2))
    b[:, 3:6] = [4.2, 1.9, 1.6] * random.uniform(0.9, 1.1, (n, 3))
    b[:, 6] = random.uniform(-3, 3, places)[at] + random.normal(0, 0.1, n)
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
def test_suppression_is_the_greedy_one(iou: float) -> None:
    for seed, n in enumerate([1, 2, 50, 400]):
        b, scores = crowd(n, 20, seed)
        wanted = greedy(b.numpy(), scores.numpy(), iou, n)
        assert boxes.nms(b, scores, iou, n).tolist() == wanted
        assert boxes.nms(b, scores, iou, 7).tolist() == wanted[:7]


def test_suppression_of_equal_boxes_and_scores_keeps_the_first() -> None:
    b = torch.tensor([[10.0, 2, -5, 4, 2, 1.5, 0.3]]).repeat(5, 1)
    assert boxes.nms(b, torch.ones(5), 0.5, 10).tolist() == [0]
    assert boxes.nms(b, torch.ones(5), 1.0, 10).tolist() == [0, 1, 2, 3, 4]


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
