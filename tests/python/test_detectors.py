"""The networks: their parts, whether they can overfit, and their results for unusual clouds."""

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import FLOOR_Z, SITE, road_sample, vehicle_points  # noqa: E402

from pyinfra.core import boxes as exact  # noqa: E402
from pyinfra.dataset.outlines import in_outline  # noqa: E402
from pyinfra.dataset.regions import Region, roads_region  # noqa: E402
from pyinfra.dataset.roads import Road  # noqa: E402
from pyinfra.formats.kitti import WorldPose  # noqa: E402
from pyinfra.models.detectors import Detections, bev  # noqa: E402
from pyinfra.models.detectors import network as network_module  # noqa: E402
from pyinfra.models.detectors.anchors import AnchorConfig, Anchors, decode, encode, is_backwards  # noqa: E402
from pyinfra.models.detectors.batch import make_batch  # noqa: E402
from pyinfra.models.detectors.catalogue import DETECTORS  # noqa: E402
from pyinfra.models.detectors.centre_head import AxisHead, CentreHead  # noqa: E402
from pyinfra.models.detectors.detection_area import Area, Site, site_of  # noqa: E402
from pyinfra.models.detectors.fuse_batchnorm import fused  # noqa: E402
from pyinfra.models.detectors.network import Network, one_thread  # noqa: E402
from pyinfra.models.detectors.pillars import PillarEncoder  # noqa: E402
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
LEARNT = [name for name, entry in DETECTORS.items() if entry.learnt]
FIRST = (
    "pointpillars",
    "centerpoint-pillar",
)  # the others take longer


def network_of(name: str) -> Network:
    recipe = read_recipe(ROOT / f"configs/detectors/{name}.yaml", "smoke")
    torch.manual_seed(1)
    return checkpoint.build(name, recipe.network, SITE)


def overlaps(detections: Detections, boxes: np.ndarray) -> list[float]:
    """Returns the largest IoU of each box with a detection."""
    if len(detections) == 0:
        return [0.0] * len(boxes)
    return exact.bev_iou(boxes, detections.boxes).max(axis=1).tolist()


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in FIRST else pytest.mark.nightly) for name in LEARNT],
)
def test_overfits_one_frame_without_a_miss_or_a_false_positive(name: str) -> None:
    sample, network = road_sample(1), network_of(name)
    batch = make_batch([sample], network.site.area)
    optimizer = torch.optim.AdamW(network.parameters(), 0.003)
    with one_thread():
        for step in range(400):
            network.train()
            loss = torch.stack(list(network.losses(batch).values())).sum()
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 10)
            optimizer.step()
            if step % 20 == 19:
                detections = network.eval().predict(sample.points)
                good = (
                    len(detections) == len(sample.boxes)
                    and min(overlaps(detections, sample.boxes)) > 0.7
                )
                if good:
                    break
    assert len(detections) == len(sample.boxes)
    assert min(overlaps(detections, sample.boxes)) > 0.7
    order = exact.bev_iou(sample.boxes, detections.boxes).argmax(axis=1)
    turn = np.abs(detections.boxes[order, 6] - sample.boxes[:, 6]) % np.pi
    assert (np.minimum(turn, np.pi - turn) < 0.1).all()


@pytest.mark.parametrize("name", LEARNT)
@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 4), np.float32),
        np.array([[10, 0, -5, 0.5]], np.float32),
        np.full((5, 4), np.nan, np.float32),
        np.full((5, 4), np.inf, np.float32),
        np.full((5, 4), 1e6, np.float32),
        np.tile(np.array([[10, 0, -5, 0.5]], np.float32), (5000, 1)),
    ],
    ids=["empty", "one point", "nan", "inf", "out of the area", "duplicates"],
)
def test_odd_clouds_give_an_answer(name: str, points: np.ndarray) -> None:
    before = points.copy()
    detections = network_of(name).eval().predict(points)
    assert detections.boxes.shape == (len(detections), 7)
    assert np.isfinite(detections.boxes).all()
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize("name", LEARNT)
def test_points_that_are_not_finite_change_nothing(name: str) -> None:
    network, points = network_of(name).eval(), road_sample(2).points
    bad = np.concatenate([points, np.full((7, 4), np.nan, np.float32)])
    bad[-1] = [10, 0, -5, np.inf]
    np.testing.assert_array_equal(network.predict(points).boxes, network.predict(bad).boxes)


@pytest.mark.parametrize("name", LEARNT)
def test_a_frame_without_vehicles_is_a_valid_negative(name: str) -> None:
    network, sample = network_of(name).train(), road_sample(3)
    none = Sample(sample.points, np.empty((0, 7)))
    few = [Sample(sample.points[:n], none.boxes) for n in (0, 1, 2)]
    for samples in ([none], [none, sample], [few[0], sample], [few[1]], [few[2]], few[:2]):
        losses = network.losses(make_batch(samples, network.site.area))
        total = torch.stack(list(losses.values())).sum()
        assert torch.isfinite(total)
        total.backward()
    grads = [p.grad for p in network.parameters() if p.grad is not None]
    assert grads
    assert all(torch.isfinite(grad).all() for grad in grads)


@pytest.mark.parametrize("name", LEARNT)
def test_layers_of_half_the_bits_learn_in_whole_ones(name: str) -> None:
    batch = make_batch([road_sample(1), road_sample(2)], network_of(name).site.area)
    whole, half = network_of(name).train(), network_of(name).train()
    expected = whole.losses(batch)
    half_bits = []
    for module in half.modules():
        if isinstance(module, torch.nn.Linear | torch.nn.Conv2d):
            module.register_forward_hook(lambda _m, _i, out: half_bits.append(out.dtype))
    with torch.autocast("cpu", torch.bfloat16):
        losses = half.losses(batch)
    assert set(half_bits) == {torch.bfloat16}
    assert {loss.dtype for loss in losses.values()} == {torch.float32}
    # The sum is compared, because second stages look at other proposals if the scores of the first
    # stage change.
    total = torch.stack(list(losses.values())).sum()
    assert total.item() == pytest.approx(sum(v.item() for v in expected.values()), rel=0.25)
    total.backward()
    for parameter in half.parameters():
        if parameter.grad is not None:
            assert parameter.grad.dtype == torch.float32
            assert torch.isfinite(parameter.grad).all()


@needs_gpu
@pytest.mark.parametrize("precision", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("name", LEARNT)
def test_a_step_on_a_gpu_is_as_on_the_cpu(name: str, precision: torch.dtype) -> None:
    networks = {device: network_of(name).train().to(device) for device in ("cpu", "cuda")}
    batch = make_batch([road_sample(1), road_sample(2)], networks["cpu"].site.area)
    totals = {}
    for device, network in networks.items():
        half = precision == torch.bfloat16 and device == "cuda"
        with torch.autocast(device, torch.bfloat16, enabled=half):
            losses = network.losses(batch.to(torch.device(device)))
        totals[device] = torch.stack(list(losses.values())).sum()
        totals[device].backward()
        torch.optim.AdamW(network.parameters(), 1e-4).step()
        assert all(torch.isfinite(p).all() for p in network.parameters())
    assert totals["cuda"].item() == pytest.approx(totals["cpu"].item(), rel=0.1)
    detections = networks["cuda"].eval().predict(road_sample(2).points)
    assert np.isfinite(detections.boxes).all()


@needs_gpu
@pytest.mark.parametrize("name", ["pointpillars", "centerpoint-pillar", "dsvt"])
def test_boxes_of_a_gpu_are_those_of_the_cpu(name: str) -> None:
    network, points = lived_in(network_of(name)), road_sample(4).points
    here = network.predict(points)
    there = network.to("cuda").predict(points)
    assert len(here) > 10
    # A box whose score is near the threshold, or whose overlap with a better box is near the limit
    # of the suppression, may be missing on one device. Boxes of equal scores may change places.
    for some, others in ((here, there), (there, here)):
        sure = some.scores > network.min_score + 1e-3
        apart = np.abs(some.boxes[:, None] - others.boxes[None]).max(axis=2).min(axis=1)
        assert np.mean(apart[sure] < 1e-2) > 0.97


def tilted(points: np.ndarray, degrees: float) -> np.ndarray:
    """Rotates points as if the sensor had another pitch than the known one."""
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32)
    return np.concatenate([points[:, :3] @ turn.T, points[:, 3:]], axis=1)


def with_intensity(points: np.ndarray, value: float) -> np.ndarray:
    return np.concatenate([points[:, :3], np.full_like(points[:, 3:], value)], axis=1)


@pytest.mark.parametrize("name", LEARNT)
@pytest.mark.parametrize(
    "change",
    [
        lambda points: points[::8],
        lambda points: np.repeat(points, 4, axis=0),
        lambda points: with_intensity(points, 0),
        lambda points: with_intensity(points, 255),
        lambda points: tilted(points, 5),
        lambda points: tilted(points, -5),
    ],
    ids=["fewer lines", "more lines", "dark", "another scale", "pitch up", "pitch down"],
)
def test_another_sensor_gives_finite_boxes(
    name: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    detections = network_of(name).eval().predict(change(road_sample(5).points))
    assert np.isfinite(detections.boxes).all()
    assert ((detections.scores >= 0) & (detections.scores <= 1)).all()


@pytest.mark.parametrize("name", LEARNT)
def test_vehicles_at_the_border_and_at_half_a_turn_are_learnt_from(name: str) -> None:
    low, high = SITE.area.low, SITE.area.high
    size = (4.3, 1.85, 1.6)
    z = FLOOR_Z + size[2] / 2
    poses = [
        (low[0] + 0.01, 0.0, z, *size, math.pi),  # half of the box is outside
        (high[0] - 0.01, 5.0, z, *size, -math.pi),
        (20.0, high[1] - 0.01, z, *size, math.pi / 2),
        (20.0, low[1] - 0.5, z, *size, 0.0),  # the centre is outside, so the box is not learnt
    ]
    boxes = np.array(poses)
    clouds = [road_sample(6).points, *(vehicle_points(b, np.random.default_rng(1)) for b in boxes)]
    network = network_of(name).train()
    points = np.concatenate(clouds)
    area = dataclasses.replace(network.site.area, low=low, high=high)
    batch = make_batch([Sample(points, boxes)], area)
    assert [len(b) for b in batch.boxes] == [3]
    total = torch.stack(list(network.losses(batch).values())).sum()
    total.backward()
    assert torch.isfinite(total)
    assert all(torch.isfinite(p.grad).all() for p in network.parameters() if p.grad is not None)


def test_half_a_turn_either_way_is_one_heading() -> None:
    boxes = torch.tensor([[20.0, 0, -5.2, 4.3, 1.85, 1.6, math.pi]]).repeat(2, 1)
    boxes[1, 6] = -math.pi
    anchors = boxes.clone()
    anchors[:, 6] = 0
    decoded = decode(encode(boxes, anchors), anchors, is_backwards(boxes[:, 6]))
    turn = (decoded[:, 6] - math.pi + math.pi) % (2 * math.pi) - math.pi
    assert turn.abs().max() < 1e-5
    assert is_backwards(boxes[:, 6]).all()


def test_a_point_in_every_pillar_is_no_pillar_too_many() -> None:
    encoder = PillarEncoder(SITE.area, 0.1, 8).eval()
    row, column = np.divmod(np.arange(encoder.rows * encoder.columns), encoder.columns)
    points = np.stack([column * 0.1 + 0.05, row * 0.1 - 12.75, row * 0 - 5, row * 0 + 0.5], axis=1)
    batch = make_batch([Sample(points.astype(np.float32), np.empty((0, 7)))], SITE.area)
    features, pillar = encoder.occupied(batch)
    assert len(pillar) == len(features) == encoder.rows * encoder.columns == 98304
    assert encoder.canvas(features, pillar, 1).shape == (1, 8, 256, 384)


def test_an_anchor_far_below_its_vehicle_still_leads_to_it() -> None:
    anchors = Anchors(AnchorConfig(), SITE, 0.8, (32, 48))
    high = torch.tensor([[20.0, 0.3, FLOOR_Z + 4.0, 4.3, 1.85, 1.6, 0.1]])
    targets = anchors.targets(high)
    assert targets.positive.any()
    matched = anchors.boxes[targets.positive]
    wanted = high.expand(len(matched), 7)
    decoded = decode(encode(wanted, matched), matched, is_backwards(wanted[:, 6]))
    torch.testing.assert_close(decoded, wanted, atol=1e-4, rtol=1e-4)


def test_a_truck_is_for_the_long_anchors() -> None:
    anchors = Anchors(AnchorConfig(), SITE, 0.8, (32, 48))
    truck = torch.tensor([[20.0, 0.4, FLOOR_Z + 1.6, 9.0, 2.5, 3.2, 0.0]])
    overlap = anchors.axis_aligned_iou(truck)[..., 0]  # (rows, columns, anchor sizes)
    kinds = anchors.targets(truck).positive.nonzero()[:, 2].unique()
    assert overlap[..., :2].max() < 0.45  # no anchor of a car matches the truck
    assert kinds.tolist() == [2]


@pytest.mark.parametrize("name", LEARNT)
def test_frames_of_a_batch_do_not_see_each_other(name: str) -> None:
    network = network_of(name).eval()
    clouds = [road_sample(seed).points for seed in (4, 5)]
    together = network.find(clouds)
    turned = network.find(clouds[::-1])[::-1]
    alone = [network.predict(cloud) for cloud in clouds]
    for a, b, c in zip(together, turned, alone, strict=True):
        np.testing.assert_allclose(a.boxes, b.boxes, atol=1e-3)
        np.testing.assert_allclose(a.scores, c.scores, atol=1e-4)


def lived_in(network: Network) -> Network:
    """Changes a network as a training does: its norms have statistics, and its scores are above the
    minimum."""
    draw = torch.Generator().manual_seed(2)
    for module in network.modules():
        if isinstance(module, torch.nn.modules.batchnorm._BatchNorm):
            module.running_mean = torch.randn(module.num_features, generator=draw) / 10
            module.running_var = 0.5 + torch.rand(module.num_features, generator=draw)
            module.weight.data = 0.5 + torch.rand(module.num_features, generator=draw)
    for name, parameter in network.named_parameters():
        if name in ("head.score.bias", "head.heat.bias", "head.heat.1.bias"):
            parameter.data.zero_()
    return network.eval()


@pytest.mark.parametrize("name", LEARNT)
def test_a_fused_network_finds_the_same_boxes(name: str) -> None:
    network = lived_in(network_of(name))
    clouds = [road_sample(seed).points for seed in (4, 5)]
    before = network.find(clouds)
    norms = sum(isinstance(m, torch.nn.BatchNorm2d) for m in network.modules())
    after = fused(network).find(clouds)
    left = sum(isinstance(m, torch.nn.BatchNorm2d) for m in network.modules())
    assert left == (0 if hasattr(network, "encoder") else norms)
    for a, b in zip(before, after, strict=True):
        assert len(a) > 10 or not hasattr(network, "encoder")
        np.testing.assert_allclose(a.boxes, b.boxes, atol=1e-4)
        np.testing.assert_allclose(a.scores, b.scores, atol=1e-5)


def test_memory_is_kept_only_where_the_c_library_can(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    class Glibc:
        def mallopt(self, what: int, size: int) -> int:
            calls.append((what, size))
            return 1

    for library in (Glibc, object):
        monkeypatch.setattr(network_module.ctypes, "CDLL", lambda _, kind=library: kind())
        network_module.keep_memory.__wrapped__()
    assert calls == [(-3, 1 << 30), (-1, (1 << 31) - 1)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_an_area_holds_its_low_side_and_nothing_that_is_not_finite(dtype: type) -> None:
    area = Area((0.0, -1.0, -2.0), (1.0, 1.0, 2.0))
    xyz = np.array(
        [
            [0, -1, -2],
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 2],
            [-1e-6, 0, 0],
            [np.nan, 0, 0],
            [0, 0, np.inf],
        ],
        dtype,
    )
    assert area.holds(xyz).tolist() == [True] + [False] * 6
    assert area.holds(xyz[:0]).shape == (0,)


def test_pillars_do_not_depend_on_the_order_of_points() -> None:
    encoder = PillarEncoder(SITE.area, 0.4, 8).eval()
    sample = road_sample(6)
    shuffled = np.random.default_rng(1).permutation(sample.points)
    canvases = [
        encoder(make_batch([Sample(points, sample.boxes)], SITE.area))
        for points in (sample.points, shuffled)
    ]
    torch.testing.assert_close(*canvases, atol=1e-5, rtol=0)


def test_a_point_lands_in_the_pillar_around_it() -> None:
    encoder = PillarEncoder(SITE.area, 0.4, 8)
    for x, y in ((0.0, -12.8), (38.39, 12.79), (20.1, 0.3)):
        points = np.array([[x, y, -5, 0.5]], np.float32)
        batch = make_batch([Sample(points, np.empty((0, 7)))], SITE.area)
        row, column = divmod(int(encoder.pillar_of(batch)), encoder.columns)
        assert (row, column) == (int((y + 12.8) / 0.4 + 1e-6), int(x / 0.4 + 1e-6))


@pytest.mark.parametrize("step", [0.8, 3.2, 5.0])
def test_a_grown_area_holds_the_old_one_in_whole_cells(step: float) -> None:
    area = Area((-107.7, -19.1, -7.0), (106.6, 19.2, -1.7))
    grown = area.grown(step)
    for axis in (0, 1):
        assert grown.low[axis] <= area.low[axis]
        assert grown.high[axis] >= area.high[axis]
        cells = grown.size[axis] / step
        assert cells == pytest.approx(round(cells), abs=1e-6)
    assert (grown.low[2], grown.high[2]) == (area.low[2], area.high[2])


def test_the_site_holds_every_vehicle() -> None:
    samples = [road_sample(seed) for seed in range(5)]
    site = site_of([sample.boxes for sample in samples])
    for sample in samples:
        assert site.area.holds(sample.boxes[:, :3]).all()
    with pytest.raises(
        ValueError, match="expected one or more labelled vehicles in the training frames"
    ):
        site_of([np.empty((0, 7))])


def test_the_site_is_as_wide_as_the_region_whatever_a_lidar_sees_of_it() -> None:
    corners = np.array([[-20.0, -5.0], [80.0, -5.0], [80.0, 10.0], [-20.0, 10.0]])
    region = Region(partial(in_outline, corners), corners)
    near, far = np.array([[5.0, 0, -5, 4, 2, 2, 0]]), np.array([[300.0, 0, -5, 4, 2, 2, 0]])
    sites = [site_of([boxes], [region]) for boxes in (near, np.concatenate([near, far]))]
    assert sites[0] == sites[1]
    assert sites[0].area.low == (-28, -13, -7)
    assert sites[0].area.high == (88, 18, -3)


@pytest.mark.parametrize("stride", [1, 2])
def test_gradients_of_a_convolution_are_those_of_torch(
    stride: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bev, "PLANES_ARE_FASTER", True)  # on every processor
    torch.manual_seed(1)
    layer = bev.Convolution(3, 5, stride).to(memory_format=torch.channels_last)
    x = torch.randn(2, 3, 6, 8).to(memory_format=torch.channels_last).requires_grad_()
    plain = torch.nn.functional.conv2d(x, layer.weight, None, stride, padding=1)
    wanted = torch.autograd.grad(plain.square().sum(), (x, layer.weight))
    output = layer(x)
    assert type(output.grad_fn).__name__ == "PlaneGradientBackward"
    assert torch.equal(output, plain)
    for gradient, right in zip(
        torch.autograd.grad(output.square().sum(), (x, layer.weight)), wanted, strict=True
    ):
        torch.testing.assert_close(gradient, right)


def test_residuals_of_anchors_round_trip_through_every_heading() -> None:
    draw = torch.Generator().manual_seed(1)
    boxes = torch.rand(200, 7, generator=draw) * torch.tensor([30.0, 20, 2, 8, 3, 3, 0]) + 0.5
    boxes[:, 6] = torch.linspace(-math.pi, math.pi - 1e-3, 200)
    anchors = boxes[torch.randperm(200, generator=draw)].clone()
    anchors[:, 6] = torch.tensor([0.0, math.pi / 2]).repeat(100)
    decoded = decode(encode(boxes, anchors), anchors, is_backwards(boxes[:, 6]))
    torch.testing.assert_close(decoded[:, :6], boxes[:, :6], atol=1e-4, rtol=1e-4)
    turn = (decoded[:, 6] - boxes[:, 6] + math.pi) % (2 * math.pi) - math.pi
    assert turn.abs().max() < 1e-4


def test_anchors_match_by_the_exact_overlap_of_upright_footprints() -> None:
    anchors = Anchors(AnchorConfig(), SITE, 0.8, (32, 48))
    boxes = torch.from_numpy(road_sample(7).boxes).float()
    boxes[:, 6] = torch.tensor([0.0, math.pi / 2, math.pi, -math.pi / 2])
    computed = anchors.axis_aligned_iou(boxes)
    flat = anchors.boxes.flatten(0, 2)[::97].double().numpy()
    wanted = exact.bev_iou(flat, boxes.double().numpy())
    np.testing.assert_allclose(computed.flatten(0, 2)[::97].numpy(), wanted, atol=1e-5)
    targets = anchors.targets(boxes)
    assert set(targets.box[targets.positive].tolist()) == {0, 1, 2, 3}
    assert not (targets.positive & targets.negative).any()


def test_a_vehicle_of_no_anchors_size_still_gets_one() -> None:
    anchors = Anchors(AnchorConfig(), SITE, 0.8, (32, 48))
    motorcycle = torch.tensor([[20.0, 0.3, -5.3, 2.2, 0.8, 1.4, 0.4]])
    assert anchors.targets(motorcycle).positive.any()


def test_a_centre_survives_its_cell_and_has_all_the_heat() -> None:
    head = CentreHead(4, 4, SITE, 0.8)
    boxes = torch.from_numpy(road_sample(8).boxes).float()
    row, column = head.cells_of(boxes, (32, 48))
    torch.testing.assert_close(
        head.decode(head.encode(boxes, row, column), row, column), boxes, atol=1e-4, rtol=1e-4
    )
    heat = head.heat_of(boxes, (32, 48))
    assert (heat[row, column] == 1).all()
    assert heat.max() == 1
    assert (heat == 1).sum() == len(boxes)


def test_with_balance_frames_weigh_the_same_however_many_objects_they_have() -> None:
    """With balance 1, a frame with twice as many objects has the same share of the loss. With
    balance 0 it has twice the share."""
    torch.manual_seed(1)
    head = AxisHead(4, 4, SITE, 0.8)
    box = torch.from_numpy(road_sample(8).boxes[:1]).float()
    x = torch.randn(2, 4, 32, 48)

    def box_loss(boxes: tuple[torch.Tensor, ...], balance: float) -> float:
        numbers = tuple(torch.zeros(len(b), dtype=torch.int64) for b in boxes)
        with torch.no_grad():
            return float(head.eval().losses(x, boxes, numbers, balance)["box"])

    none = box[:0]
    first, second = box_loss((box, none), 1.0), box_loss((none, box), 1.0)
    three = (box.repeat(3, 1), box)
    assert box_loss(three, 1.0) == pytest.approx((first + second) / 2, rel=1e-5)
    assert box_loss(three, 0.0) == pytest.approx((3 * first + second) / 4, rel=1e-5)


def test_an_axis_and_a_way_are_a_heading() -> None:
    head = AxisHead(4, 4, SITE, 0.8)
    boxes = torch.from_numpy(road_sample(8).boxes[:1]).float().repeat(64, 1)
    boxes[:, 6] = torch.linspace(-math.pi, math.pi, 65)[:64]
    row, column = head.cells_of(boxes, (32, 48))
    for sign in (1, -1):  # first a correct direction of the road, then a wrong one
        way = torch.where(is_backwards(boxes[:, 6]), sign, -sign)[:, None].float()
        residuals = torch.cat([head.encode(boxes, row, column), way], dim=1)
        turned = head.decode(residuals, row, column)[:, 6] - boxes[:, 6]
        torch.testing.assert_close(turned.cos(), torch.full((64,), float(sign)), atol=1e-5, rtol=0)


def crossing(way: float = math.pi / 6) -> Region:
    """Returns two roads that cross at the sensor. Their world frame is rotated and shifted."""
    s = np.arange(-40.0, 41)
    ahead, same = np.stack([np.cos(way + 0 * s), np.sin(way + 0 * s)], axis=1), np.ones(len(s))
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    middle = [100.0, 50.0]
    roads = [
        Road("main", s, middle + s[:, None] * ahead, 0 * s, way * same, 3 * same),
        Road("side", s, middle + s[:, None] * left, 0 * s, (way + math.pi / 2) * same, 3 * same),
    ]
    return roads_region(roads, WorldPose(100, 50, 6, way))


def test_roads_have_an_axis_where_one_is_and_none_where_two_cross_or_off_them() -> None:
    region = crossing()
    assert region.axes is not None
    positions = np.array([[30.0, 1.0], [-30.0, -4.5], [1.0, -25.0], [1.0, 1.0], [30.0, 9.0]])
    sin, cos = region.axes(positions).T
    np.testing.assert_allclose(sin, 0, atol=1e-12)
    np.testing.assert_allclose(cos, [1, 1, -1, 0, 0], atol=1e-12)


def test_a_road_s_axis_fills_up_what_is_missing_of_a_vehicle_s() -> None:
    head = AxisHead(4, 4, SITE, 0.8)
    head.know(crossing(), (32, 48))
    box = torch.tensor([[20.0, 0.5, -4.5, 4.0, 2.0, 1.5, math.pi / 3]])
    row, column = head.cells_of(box, (32, 48))
    residuals = torch.cat([head.encode(box, row, column), torch.zeros(1, 1)], dim=1)
    sure = head.decode(residuals, row, column)[0, 6]
    assert sure == pytest.approx(math.pi / 3, abs=1e-5)
    unsure = residuals.clone()
    unsure[:, 6:8] *= 1e-3
    assert head.decode(unsure, row, column)[0, 6] == pytest.approx(0, abs=1e-2)


def test_a_centre_that_float32_rounds_onto_the_rim_is_in_the_last_cell() -> None:
    head = CentreHead(4, 4, SITE, 0.8)
    box = torch.from_numpy(road_sample(8).boxes[:1]).float()
    box[0, :2] = torch.tensor(SITE.area.high[:2])
    row, column = head.cells_of(box, (32, 48))
    assert (row.tolist(), column.tolist()) == ([31], [47])


def test_detectors_are_given_by_name_and_class() -> None:
    for name, entry in DETECTORS.items():
        config = ROOT / f"configs/detectors/{name}.yaml"
        assert config.is_file()
        if entry.learnt:
            for tier in ("smoke", "quick", "full"):
                read_recipe(config, tier)  # type: ignore[arg-type]


def test_another_site_is_another_grid(tmp_path: Path) -> None:
    small = dataclasses.replace(SITE, area=Area((0.0, -5.0, -7.0), (20.0, 5.0, -1.0)))
    recipe = read_recipe(ROOT / "configs/detectors/pointpillars.yaml", "smoke")
    network = checkpoint.build("pointpillars", recipe.network, small)
    assert isinstance(network.site, Site)
    assert network.eval().predict(road_sample(9).points).boxes.shape[1] == 7


def test_networks_answer_the_same_twice() -> None:
    answers: list[Callable[[], Detections]] = []
    for name in LEARNT:
        network, points = network_of(name).eval(), road_sample(10).points
        answers.append(lambda n=network, p=points: n.predict(p))  # type: ignore[misc]
    for answer in answers:
        np.testing.assert_array_equal(answer().boxes, answer().boxes)
