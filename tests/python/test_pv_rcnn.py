"""PV-RCNN: features of key points, grids that rotate with proposals, and changes by the second
stage."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import FLOOR_Z, SITE, road_sample  # noqa: E402

from pyinfra.models.detectors.batch import Batch, make_batch  # noqa: E402
from pyinfra.models.detectors.pointnet import Clouds, neighbours, shuffled  # noqa: E402
from pyinfra.models.detectors.pv_rcnn import (  # noqa: E402
    FOREGROUND_IOU,
    RADII,
    Config,
    PvRcnn,
    corner_loss,
    foreground_loss,
    grid_corners,
    grid_points,
    is_around,
    raw_points,
    refined,
    refinement_losses,
    spread_by_overlap,
    wanted_residuals,
)
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

CONFIG = Path(__file__).resolve().parents[2] / "configs/detectors/pv-rcnn.yaml"


def network(**changes: object) -> PvRcnn:
    torch.manual_seed(1)
    config = dataclasses.replace(read_recipe(CONFIG, "smoke").network, **changes)
    return PvRcnn(config, SITE).eval()


def some_boxes(count: int) -> torch.Tensor:
    draw = torch.Generator().manual_seed(count)
    low = torch.tensor([5.0, -10, -6, 1, 1, 1, -math.pi])
    high = torch.tensor([35.0, 10, -4, 9, 3, 3, math.pi])
    return low + torch.rand(count, 7, generator=draw) * (high - low)


def features_of(net: PvRcnn, batch: Batch, xyz: torch.Tensor) -> torch.Tensor:
    """Returns the features of the raw points alone, at the key points xyz."""
    return net.key_points.sources[0](raw_points(batch), xyz, [len(xyz)]).features


@torch.inference_mode()
def test_a_key_point_sees_the_raw_points_near_it_and_no_other() -> None:
    net, sample = network(), road_sample(1)
    key = torch.tensor([[20.0, 5.0, FLOOR_Z], [10.0, -8.0, FLOOR_Z]])
    near, far = np.array([20.1, 5.2, FLOOR_Z, 0.5]), np.array([20.1, 7.2, FLOOR_Z, 0.5])

    def seen(point: np.ndarray) -> torch.Tensor:
        points = np.concatenate([point[None], sample.points]).astype(np.float32)
        return features_of(net, make_batch([Sample(points, sample.boxes)], SITE.area), key)

    moved = np.array([0.1, -0.1, 0.3, 0])
    assert np.linalg.norm(far[:3] - key[0].numpy()) > max(RADII[0])
    before = seen(near)
    assert (seen(near + moved)[0] - before[0]).abs().max() > 1e-4
    torch.testing.assert_close(seen(near + moved)[1], before[1])
    torch.testing.assert_close(seen(far + moved), seen(far))


def test_a_full_ball_of_voxels_is_not_its_lowest_corner() -> None:
    """Voxels are in the order of z, y, x. The voxels that are taken from a ball must lie around its
    centre."""
    net, sample = network(), road_sample(3)
    levels, _ = net.eval().backbone(make_batch([sample], SITE.area))
    car = torch.from_numpy(sample.boxes[:1, :3]).float()
    coarse, radius = shuffled(levels[-1]), RADII[-1][1]
    every, _ = neighbours(coarse.xyz, coarse.counts, car, [1], radius, 4096)
    some, _ = neighbours(coarse.xyz, coarse.counts, car, [1], radius, 32)
    assert len(every) > 3 * len(some)
    off = coarse.xyz[some].mean(dim=0) - coarse.xyz[every].mean(dim=0)
    # The mean of 32 samples differs this much from the mean of all samples in one of a thousand
    # cases.
    assert (off.abs() < 3.3 * coarse.xyz[every].std(dim=0) / 32**0.5).all()


def test_shuffling_keeps_the_points_of_each_cloud_and_is_always_the_same() -> None:
    xyz = torch.arange(30.0).view(10, 3)
    clouds = shuffled(Clouds(xyz, xyz[:, :1], [6, 0, 4]))
    assert not torch.equal(clouds.xyz, xyz)
    assert torch.equal(clouds.xyz[:6].sort(dim=0).values, xyz[:6])
    assert torch.equal(clouds.xyz[:, :1], clouds.features)
    assert torch.equal(clouds.xyz, shuffled(Clouds(xyz, xyz[:, :1], [6, 0, 4])).xyz)


@torch.inference_mode()
def test_the_canvas_at_the_middle_of_a_cell_is_that_cell() -> None:
    net = network()
    rows, columns = net.backbone.grid
    canvas = torch.rand(2, 3, rows, columns)
    low, cell = torch.tensor(net.site.area.low[:2]), net.site.area.size[0] / columns
    xyz = torch.tensor([[7.5, 4.5, 0], [8.0, 4.5, 0]])
    xyz[:, :2] = low + xyz[:, :2] * cell
    sampled = net.key_points.seen_from_above(canvas, xyz, [1, 1])
    torch.testing.assert_close(sampled[0], canvas[0, :, 4, 7], atol=1e-4, rtol=1e-4)
    between = (canvas[1, :, 4, 7] + canvas[1, :, 4, 8]) / 2
    torch.testing.assert_close(sampled[1], between, atol=1e-4, rtol=1e-4)


@torch.inference_mode()
def test_the_middle_of_a_voxel_is_near_its_points() -> None:
    net = network()
    points = np.array([[20.11, 5.32, -5.3, 0.5]], np.float32)
    levels, canvas = net.backbone(make_batch([Sample(points, np.empty((0, 7)))], net.site.area))
    assert canvas.shape == (1, net.backbone.channels, *net.backbone.grid)
    for level, (along, _, up) in zip(levels, net.backbone.strides, strict=True):
        reach = np.array([along * 0.2, along * 0.2, up * 0.25])  # size of a voxel of this level
        apart = (level.xyz - torch.from_numpy(points[:, :3])).abs().numpy()
        assert (apart.min(axis=0) <= reach).all()
        assert (apart <= 2 * reach).all()


def test_grid_points_turn_with_the_proposal_and_fill_it() -> None:
    boxes = some_boxes(20)
    turned = boxes.clone()
    turned[:, 6] += 0.7
    before, after = grid_points(boxes, 6), grid_points(turned, 6)
    assert before.shape == (20, 216, 3)
    offset, offset_turned = before - boxes[:, None, :3], after - boxes[:, None, :3]
    cos, sin = math.cos(0.7), math.sin(0.7)
    wanted = torch.stack(
        [
            cos * offset[..., 0] - sin * offset[..., 1],
            sin * offset[..., 0] + cos * offset[..., 1],
            offset[..., 2],
        ],
        dim=-1,
    )
    torch.testing.assert_close(offset_turned, wanted, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(before.mean(dim=1), boxes[:, :3], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(  # the diagonal from the first to the last point
        (before[:, 0] - before[:, -1]).norm(dim=1), boxes[:, 3:6].norm(dim=1) * 5 / 6
    )


def test_corners_are_those_of_the_box() -> None:
    boxes = some_boxes(5)
    upright = torch.cat([torch.zeros(5, 3), boxes[:, 3:6], torch.zeros(5, 1)], dim=1)
    computed = grid_corners(upright)
    torch.testing.assert_close(computed.abs(), (boxes[:, None, 3:6] / 2).expand(-1, 8, -1))
    assert all(len(torch.unique(corners.sign(), dim=0)) == 8 for corners in computed)
    apart = torch.cdist(grid_corners(boxes), grid_corners(boxes))
    torch.testing.assert_close(apart, torch.cdist(computed, computed), atol=1e-4, rtol=1e-4)


def test_no_residuals_give_the_proposals() -> None:
    boxes = some_boxes(50)
    result = refined(boxes, torch.zeros(50, 7))
    torch.testing.assert_close(result[:, :6], boxes[:, :6], atol=0, rtol=0)
    torch.testing.assert_close(result[:, 6], boxes[:, 6], atol=1e-6, rtol=0)


def test_refined_headings_stay_within_a_turn() -> None:
    boxes, residuals = some_boxes(50), torch.zeros(50, 7)
    residuals[:, 6] = torch.linspace(-1.5, 1.5, 50)
    heading = refined(boxes, residuals)[:, 6]
    assert (heading.abs() <= math.pi).all()
    turns = (heading - boxes[:, 6] - residuals[:, 6]) / (2 * math.pi)
    assert (turns - turns.round()).abs().max() < 1e-5


def test_wanted_residuals_lead_to_the_vehicles_up_to_half_a_turn() -> None:
    boxes, truth = some_boxes(60), some_boxes(61)[:60]
    residuals = wanted_residuals(boxes, truth)
    assert (residuals[:, 6].abs() <= math.pi / 2 + 1e-5).all()
    result = refined(boxes, residuals)
    torch.testing.assert_close(result[:, :6], truth[:, :6], atol=1e-4, rtol=1e-4)
    half_turns = (result[:, 6] - truth[:, 6]) / math.pi
    assert (half_turns - half_turns.round()).abs().max() < 1e-4
    assert corner_loss(result, truth).max() < 1e-6


def test_the_second_stage_has_nothing_to_correct_on_the_vehicles_themselves() -> None:
    boxes = torch.from_numpy(road_sample(2).boxes).float()
    parts = refinement_losses(torch.full((4,), 20.0), torch.zeros(4, 7), [boxes], (boxes,))
    assert all(part < 1e-6 for part in parts.values())
    unsure = refinement_losses(torch.zeros(4), torch.zeros(4, 7), [boxes + 0.2], (boxes,))
    assert all(part > 0 for part in unsure.values())


def test_what_is_learnt_from_is_half_on_vehicles_at_most() -> None:
    overlap = torch.linspace(1, 0, 200)
    rows = spread_by_overlap(overlap, 64)
    assert len(rows) == len(rows.unique()) == 64
    assert (overlap[rows] >= FOREGROUND_IOU).sum() == 32
    assert (overlap[rows] < 0.1).sum() == 32 - int(32 * 0.8)
    assert len(spread_by_overlap(torch.zeros(200), 64)) == 64
    assert len(spread_by_overlap(torch.full((200,), 0.3), 64)) == 64
    assert len(spread_by_overlap(torch.zeros(0), 64)) == 0


def test_key_points_lie_around_proposals_where_asked_for() -> None:
    sample = road_sample(3)
    batch = make_batch([sample], SITE.area)
    boxes = torch.from_numpy(sample.boxes).float()
    raw = raw_points(batch)
    around, counts = network(around_m=1.0).rows_of_key_points(raw, [boxes])
    anywhere, _ = network(around_m=0.0).rows_of_key_points(raw, [boxes])
    assert len(around.unique()) == len(anywhere.unique()) == 512
    assert counts == [512]
    assert is_around(raw.xyz[around], boxes, 1.0).all()
    assert not is_around(raw.xyz[anywhere], boxes, 1.0).all()
    none, counts = network(around_m=1.0).rows_of_key_points(raw, [boxes[:0]])
    assert (len(none), counts) == (0, [0])


def test_key_points_just_outside_a_vehicle_do_not_count() -> None:
    box = torch.tensor([[10.0, 0, -5, 4, 2, 2, 0]])
    xyz = torch.tensor([[10.0, 0, -5], [12.05, 0, -5], [14.0, 0, -5]])
    key = Clouds(xyz, torch.zeros(3, 1), [3])
    sure = torch.tensor([9.0, 0, -9.0])
    assert foreground_loss(key, sure, (box,)) < 1e-3
    assert foreground_loss(key, -sure, (box,)) > 1
    assert foreground_loss(key, sure, (box[:0],)).isfinite()


@pytest.mark.parametrize("count", [0, 1, 2, 7])
@pytest.mark.parametrize("around_m", [0.0, 1.0])
def test_clouds_with_fewer_points_than_key_points_are_learnt_from(
    count: int, around_m: float
) -> None:
    net, sample = network(around_m=around_m).train(), road_sample(4)
    few = Sample(sample.points[len(sample.points) - count :], sample.boxes)
    losses = net.losses(make_batch([few], SITE.area))
    total = torch.stack(list(losses.values())).sum()
    assert torch.isfinite(total)
    total.backward()
    assert all(torch.isfinite(p.grad).all() for p in net.parameters() if p.grad is not None)


def test_without_a_proposal_on_a_vehicle_nothing_is_refined() -> None:
    proposed = torch.tensor([[10.0, 0, -5, 4, 2, 1.5, 0], [30, 5, -5, 4, 2, 1.5, 1]])
    truth = proposed[:1] + torch.tensor([0, 6.0, 0, 0, 0, 0, 0])
    scores, residuals = torch.zeros(2, requires_grad=True), torch.zeros(2, 7, requires_grad=True)
    losses = refinement_losses(scores, residuals, [proposed], (truth,))
    assert losses["confidence"].item() == pytest.approx(math.log(2))
    assert losses["refinement"].item() == losses["corner"].item() == 0
    sum(losses.values()).backward()
    assert torch.isfinite(residuals.grad).all()
    assert not refinement_losses(scores[:0], residuals[:0], [proposed[:0]], (truth,))["confidence"]


def test_key_points_without_neighbours_and_empty_levels_have_no_features() -> None:
    net = network()
    far = torch.tensor([[38.0, 12.0, -1.5]])  # no points are near this position
    raw = Clouds(torch.tensor([[5.0, -5, -5]]), torch.ones(1, 1), [1])
    widths = [source.scales[0].feature.in_features for source in net.key_points.sources]
    none = [Clouds(torch.zeros(0, 3), torch.zeros(0, width), [0]) for width in widths[1:]]
    canvas = torch.zeros(1, net.backbone.channels, *net.backbone.grid)
    for source, clouds in zip(net.key_points.sources, [raw, *none], strict=True):
        assert not source(clouds, far, [1]).features.any()
    key, logits = net.key_points([raw, *none], canvas, far, [1])
    assert torch.isfinite(key.features).all()
    assert torch.isfinite(logits).all()


def test_the_published_network_is_the_default() -> None:
    net = checkpoint.build("pv-rcnn", Config(), SITE)
    millions = sum(p.numel() for p in net.parameters()) / 1e6
    assert 12 < millions < 15
