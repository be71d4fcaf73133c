"""PointRCNN and its layers on points: rotation with the scene, sampling and pooling."""

import dataclasses
import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import FLOOR_Z, SITE, road_sample  # noqa: E402

from pyinfra.models.detectors.batch import make_batch  # noqa: E402
from pyinfra.models.detectors.detection_area import Area, Site  # noqa: E402
from pyinfra.models.detectors.pointnet import (  # noqa: E402
    Ball,
    Clouds,
    FeaturePropagation,
    Norm,
    SetAbstraction,
    WholeAbstraction,
)
from pyinfra.models.detectors.pointrcnn import (  # noqa: E402
    CONTEXT_M,
    Config,
    PointRCNN,
    SampledRois,
    Seen,
    balanced,
    by_area,
    corner_distances,
    decode,
    encode,
    grown,
    pooled,
    refined,
    refinements,
    turned_into,
    turned_out_of,
)
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.ops.clouds import farthest_of_clouds  # noqa: E402

SMALL = Config(
    points=1024, levels=(256, 128, 64, 16), width=0.2, rois=16, rois_detected=16, roi_points=64
)


def network(config: Config = SMALL, site: Site = SITE) -> PointRCNN:
    torch.manual_seed(1)
    return PointRCNN(config, site).eval()


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def clouds_of(counts: list[int], channels: int, seed: int = 1) -> Clouds:
    n = sum(counts)
    xyz = torch.rand(n, 3, generator=generator(seed)) * 5
    return Clouds(xyz, torch.rand(n, channels, generator=generator(seed + 1)), counts)


def turned(boxes: torch.Tensor, angle: float) -> torch.Tensor:
    """Rotates the boxes around the sensor."""
    pivot = torch.tensor([[0.0, 0, 0, 1, 1, 1, angle]]).expand(len(boxes), 7)
    return torch.cat([turned_out_of(boxes[:, :3], pivot), boxes[:, 3:6], boxes[:, 6:] + angle], 1)


@pytest.mark.parametrize("angle", [0.3, math.pi / 2, -2.5])
def test_the_second_stage_turns_with_scene_and_proposal(angle: float) -> None:
    net, sample = network(), road_sample(1)
    xyz = torch.from_numpy(sample.points[::3, :3].copy())
    n = len(xyz)
    channels = net.backbone.channels
    features, more = (
        torch.rand(n, channels, generator=generator(1)),
        torch.rand(n, 2, generator=generator(2)),
    )
    rois = torch.from_numpy(sample.boxes).float()
    rois = rois + torch.randn(rois.shape, generator=generator(3)) * 0.1
    pivot = torch.tensor([[0.0, 0, 0, 1, 1, 1, angle]]).expand(n, 7)
    for layer in (net.refiner.box[-1], net.refiner.confidence[-1]):
        torch.nn.init.normal_(layer.weight, std=0.05)
    outputs = []
    for where, boxes in ((xyz, rois), (turned_out_of(xyz, pivot), turned(rois, angle))):
        seen = Seen(Clouds(where, features, [n]), more[:, 0], more[:, 1], torch.zeros(n, 8))
        logits, residuals, held = net.refiner(seen, boxes, [len(boxes)])
        assert (held > 5).all()
        outputs.append((torch.sigmoid(logits), refined(residuals, boxes)))
    (scores, boxes), (scores_turned, boxes_turned) = outputs
    torch.testing.assert_close(scores, scores_turned, atol=1e-4, rtol=0)
    wanted = turned(boxes, angle)
    torch.testing.assert_close(boxes_turned[:, :6], wanted[:, :6], atol=1e-3, rtol=0)
    turn = (boxes_turned[:, 6] - wanted[:, 6] + math.pi) % (2 * math.pi) - math.pi
    assert turn.abs().max() < 1e-4
    assert scores.std() > 1e-3  # the scores of the proposals differ


def test_pooled_points_are_those_inside_the_enlarged_proposals_of_their_frame() -> None:
    samples = [road_sample(2), road_sample(3)]
    xyz = torch.from_numpy(np.concatenate([s.points[:, :3] for s in samples]))
    counts = [len(s.points) for s in samples]
    boxes = [torch.from_numpy(s.boxes).float() for s in samples]
    far = torch.tensor([[200.0, 0, 0, 4, 2, 2, 0]])
    rois = torch.cat([boxes[0], far, boxes[1]])
    clouds = Clouds(xyz, xyz, counts)
    rows, owners = pooled(clouds, rois, [len(boxes[0]) + 1, len(boxes[1])], 100_000)
    local = turned_into(xyz, torch.cat([rois[:1]]).expand(len(xyz), 7)).abs()
    inside = (local <= (rois[0, 3:6] + CONTEXT_M) / 2).all(1)
    inside[counts[0] :] = False
    assert set(rows[owners == 0].tolist()) == set(inside.nonzero()[:, 0].tolist())
    assert not (owners == len(boxes[0])).any()
    assert (rows[owners > len(boxes[0])] >= counts[0]).all()
    few, of = pooled(clouds, rois, [len(boxes[0]) + 1, len(boxes[1])], 20)
    assert torch.bincount(of).max() == 20
    assert set(few.tolist()) <= set(rows.tolist())


def propagated(fine: Clouds, coarse: Clouds) -> torch.Tensor:
    """Returns what a layer without weights brings to the fine points: (n, c)."""
    channels = coarse.features.shape[1]
    features: torch.Tensor = FeaturePropagation(0, channels, ())(fine, coarse).features
    return features[:, :channels]


def test_propagated_constant_features_are_constant() -> None:
    fine = clouds_of([30, 0, 5, 1], 2)
    rows, counts = farthest_of_clouds(fine.xyz, fine.counts, 7)
    coarse = Clouds(fine.xyz[rows], torch.full((len(rows), 3), 2.5), counts)
    torch.testing.assert_close(propagated(fine, coarse), torch.full((36, 3), 2.5))


def test_a_point_is_given_the_features_of_the_point_it_is() -> None:
    fine = clouds_of([40, 20], 2)
    torch.testing.assert_close(propagated(fine, fine), fine.features, atol=1e-4, rtol=0)


def test_sampled_points_are_of_their_cloud_and_as_many_as_there_are() -> None:
    clouds = clouds_of([30, 0, 5, 1], 2)
    rows, counts = farthest_of_clouds(clouds.xyz, clouds.counts, 7)
    assert counts == [7, 0, 5, 1]
    assert len(set(rows.tolist())) == 13
    assert rows[:7].max() < 30
    assert rows[7:12].tolist() == [30, 31, 32, 33, 34]


def test_abstraction_is_the_largest_over_the_ball_by_a_loop() -> None:
    clouds = clouds_of([40, 25], 3)
    torch.manual_seed(1)
    layer = SetAbstraction(3, [Ball(1.5, 64, (8, 6)), Ball(3.0, 64, (4,))]).eval()
    centres = torch.rand(9, 3, generator=generator(5)) * 5
    centres[8] = 100.0  # no point lies around this centre
    features = layer(clouds, centres, [4, 5]).features
    assert features.shape == (9, 10)
    for row, centre in enumerate(centres):
        part = slice(0, 40) if row < 4 else slice(40, 65)
        offset = clouds.xyz[part] - centre
        parts = []
        for ball, scale in zip(layer.balls, layer.scales, strict=True):
            near = offset.norm(dim=1) < ball.radius_m
            x = scale.rest(scale.offset(offset) + scale.feature(clouds.features[part]))
            parts.append(x[near].amax(0) if near.any() else torch.zeros(x.shape[1]))
        torch.testing.assert_close(features[row], torch.cat(parts))
    assert (features[8] == 0).all()


def test_clouds_do_not_see_each_other() -> None:
    both = clouds_of([20, 30], 3)
    torch.manual_seed(1)
    layer = WholeAbstraction(3, (8,)).eval()
    first = Clouds(both.xyz[:20], both.features[:20], [20])
    torch.testing.assert_close(layer(both)[:1], layer(first))
    assert (layer(Clouds(both.xyz, both.features, [20, 0, 30]))[1] == 0).all()


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_a_batch_of_one_row_is_not_normalised_by_itself(rows: int) -> None:
    norm = Norm(3).train()
    assert torch.isfinite(norm(torch.rand(rows, 3))).all()


def test_remedied_sampling_keeps_the_far_vehicle_that_the_faithful_one_loses() -> None:
    near = road_sample(4).points
    ground = np.tile(near, (8, 1))
    random = np.random.default_rng(1)
    ground[:, :2] = random.uniform([0, -12], [30, 12], (len(ground), 2))
    ground[:, 2] = FLOOR_Z
    far = np.column_stack(
        [random.uniform(150, 154, 6), random.uniform(0, 2, 6), [-5] * 6, [0.5] * 6]
    )
    points = torch.from_numpy(np.concatenate([ground, near, far]).astype(np.float32))
    site = Site(Area((0.0, -12.8, -7.0), (200.0, 12.8, -1.0)), FLOOR_Z)
    kept = {}
    for sampling in ("faithful", "remedied"):
        config = dataclasses.replace(SMALL, sampling=sampling, points=400)
        chosen = points[network(config, site).chosen(points, generator(1))]
        assert len(chosen) == 400
        kept[sampling] = int((chosen[:, 0] > 100).sum())
    assert kept["remedied"] == 6
    assert kept["faithful"] <= 1


def test_remedied_sampling_leaves_the_ground_out() -> None:
    points = torch.from_numpy(road_sample(5).points)
    net = network(dataclasses.replace(SMALL, sampling="remedied", points=100_000))
    chosen = points[net.chosen(points, generator(1))]
    assert chosen[:, 2].min() > FLOOR_Z + net.config.clearance_m
    assert len(chosen) == (points[:, 2] > FLOOR_Z + net.config.clearance_m).sum()


def test_by_area_every_square_comes_once_before_one_comes_twice() -> None:
    xy = torch.tensor([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [5.5, 0], [5.6, 0], [-0.5, 0.5]])
    order = by_area(xy, 1.0).tolist()
    assert sorted(order) == [0, 1, 2, 3, 4, 5]
    assert set(order[:3]) == {0, 3, 5}
    assert order[5] == 2


@pytest.mark.parametrize("sampling", ["faithful", "remedied"])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 63, 300])
def test_clouds_smaller_than_any_sample(sampling: str, count: int) -> None:
    net = network(dataclasses.replace(SMALL, sampling=sampling))
    sample = road_sample(6)
    points = sample.points[sample.points[:, 2] > FLOOR_Z + 0.3][:count]
    detections = net.predict(points)
    assert np.isfinite(detections.boxes).all()
    net.train()
    batch = make_batch(
        [Sample(points, sample.boxes), Sample(points[:0], sample.boxes[:0])], SITE.area
    )
    loss = torch.stack(list(net.losses(batch).values())).sum()
    loss.backward()
    assert torch.isfinite(loss)
    assert all(torch.isfinite(p.grad).all() for p in net.parameters() if p.grad is not None)


@pytest.mark.parametrize("sampling", ["faithful", "remedied"])
def test_far_more_points_than_the_budget_are_cut_down_to_it(sampling: str) -> None:
    net = network(dataclasses.replace(SMALL, sampling=sampling))
    rng = np.random.default_rng(1)
    low, high = SITE.area.low, SITE.area.high
    xyz = rng.uniform(low, high, (40_000, 3))
    points = np.column_stack([xyz, rng.uniform(0, 1, len(xyz))]).astype(np.float32)
    chosen = net.chosen(torch.from_numpy(points), net.generator())
    assert len(chosen) == SMALL.points
    assert len(set(chosen.tolist())) == SMALL.points
    assert np.isfinite(net.predict(points).boxes).all()


def test_duplicates_learn_and_answer() -> None:
    point = np.array([[10, 0, -5, 0.5]], np.float32)
    sample = Sample(np.tile(point, (3000, 1)), np.array([[11, 0, -5.2, 4.3, 1.9, 1.6, 0.0]]))
    net = network().train()
    loss = torch.stack(list(net.losses(make_batch([sample], SITE.area)).values())).sum()
    loss.backward()
    assert torch.isfinite(loss)
    assert np.isfinite(net.eval().predict(sample.points).boxes).all()


def test_a_proposal_without_points_has_no_score_and_teaches_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    net, batch = network(), make_batch([road_sample(7)], SITE.area)
    rois = torch.tensor([[500.0, 0, -5, 4, 2, 1.6, 0.3]])
    monkeypatch.setattr(net, "proposals", lambda seen, most: [rois])
    ((boxes, scores),) = net.candidates(batch)
    assert torch.isfinite(boxes).all()
    assert scores.tolist() == [0]
    losses = net.roi_losses(net.seen(batch), SampledRois(rois, [1], torch.ones(1), rois))
    assert {name: loss.item() for name, loss in losses.items()} == {
        "confidence": 0,
        "refinement": 0,
        "corners": 0,
    }


def test_residuals_round_trip() -> None:
    boxes = torch.from_numpy(np.concatenate([road_sample(s).boxes for s in range(8)])).float()
    xyz = boxes[:, :3] + torch.randn(len(boxes), 3, generator=generator(1))
    size = torch.tensor(Config().size_m)
    decoded = decode(encode(boxes, xyz, size), xyz, size)
    torch.testing.assert_close(decoded, boxes, atol=1e-4, rtol=1e-4)
    rois = boxes + torch.randn(boxes.shape, generator=generator(2)) * 0.1
    decoded = refined(refinements(boxes, rois), rois)
    torch.testing.assert_close(decoded[:, :6], boxes[:, :6], atol=1e-4, rtol=1e-4)
    turn = (decoded[:, 6] - boxes[:, 6] + math.pi) % (2 * math.pi) - math.pi
    assert turn.abs().max() < 1e-4


def test_corners_forget_which_end_is_the_front() -> None:
    boxes = torch.from_numpy(road_sample(8).boxes).float()
    back = torch.cat([boxes[:, :6], boxes[:, 6:] + math.pi], dim=1)
    assert corner_distances(boxes, back).max() < 1e-3
    beside = boxes + torch.tensor([0.0, 0, 0.5, 0, 0, 0, 0])
    torch.testing.assert_close(corner_distances(boxes, beside), torch.full((len(boxes), 8), 0.5))


def test_proposals_to_learn_from_are_half_good_and_mostly_hard() -> None:
    overlap = torch.cat([torch.full((50,), 0.8), torch.full((50,), 0.3), torch.zeros(50)])
    chosen = overlap[balanced(overlap, 20, generator(1))]
    assert (chosen == 0.8).sum() == 10
    assert (chosen == 0.3).sum() == 8
    assert (chosen == 0).sum() == 2
    assert len(balanced(overlap[:60], 20, generator(1))) == 20
    assert len(balanced(overlap[:3], 20, generator(1))) == 3
    assert len(balanced(overlap[:0], 20, generator(1))) == 0


def test_what_is_drawn_in_training_follows_from_the_weights_file() -> None:
    one, two = network().train(), network().train()
    batch = make_batch([road_sample(10)], SITE.area)
    one.losses(batch)
    two.load_state_dict(one.state_dict())
    a, b = one.losses(batch), two.losses(batch)
    assert all(torch.equal(a[name], b[name]) for name in a)


def test_a_grown_box_has_its_centre() -> None:
    box = torch.tensor([[1.0, 2, 3, 4, 5, 6, 0.7]])
    assert grown(box, 1.0).tolist() == [[1, 2, 3, 5, 6, 7, pytest.approx(0.7)]]
