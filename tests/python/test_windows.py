"""Windows of a canvas: training on a window gives the same losses as training on the whole canvas
there."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import FLOOR_Z, SITE, road_sample  # noqa: E402

from pyinfra.dataset.ground import level_ground  # noqa: E402
from pyinfra.models.detectors import windows  # noqa: E402
from pyinfra.models.detectors.batch import Batch, Windows, make_batch  # noqa: E402
from pyinfra.models.detectors.detection_area import Area, Site  # noqa: E402
from pyinfra.models.detectors.network import Network  # noqa: E402
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402
from pyinfra.models.training.sources import Source  # noqa: E402
from pyinfra.models.training.train import train  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
ON_PILLARS = ("pointpillars", "centerpoint-pillar", "dsvt")


def network_of(name: str, site: Site = SITE) -> Network:
    recipe = read_recipe(ROOT / f"configs/detectors/{name}.yaml", "smoke")
    torch.manual_seed(1)
    return checkpoint.build(name, recipe.network, site)


def looking_at(batch: Batch, most_m2: float, *centres: tuple[float, float]) -> Batch:
    return dataclasses.replace(batch, windows=Windows(most_m2, centres))


@pytest.mark.parametrize(
    ("whole", "cells", "sides"),
    [
        ((96, 64), 96 * 64, (96, 64)),  # the whole canvas
        ((96, 64), 1024, (32, 32)),  # a square
        # the window has the full height, then the largest possible width
        ((16, 640), 1600, (16, 96)),
        ((640, 16), 1600, (96, 16)),
        ((96, 64), 1, (8, 8)),  # at least one block of cells
    ],
)
def test_windows_are_as_square_as_they_can_be(
    whole: tuple[int, int], cells: float, sides: tuple[int, int]
) -> None:
    assert windows.sides_of(whole, cells, 8) == sides


@pytest.mark.parametrize("name", ON_PILLARS)
def test_a_window_holds_the_canvas_and_the_boxes_there(name: str) -> None:
    network = network_of(name)
    encoder, area = network.encoder, network.site.area
    batch = make_batch([road_sample(1), road_sample(2)], network.site.area)
    step = network.bev.step
    corners = [network.site.area.low[:2], network.site.area.high[:2]]
    view = windows.view_of(looking_at(batch, 300.0, *corners), area, encoder.pillar_m, step)
    rows, columns = view.sides
    assert rows % step == columns % step == 0
    assert rows * columns * encoder.pillar_m**2 <= 300
    occupied = encoder.eval().occupied(batch)
    canvas, parts = encoder.canvas(*occupied, 2), encoder.canvas(*occupied, 2, view)
    assert torch.equal(parts[0], canvas[0, :, :rows, :columns])
    assert torch.equal(parts[1], canvas[1, :, -rows:, -columns:])
    assert parts.any()
    boxes = view.boxes
    low = torch.tensor(network.site.area.low[:2])
    extent = torch.tensor([columns, rows]) * encoder.pillar_m
    for i, first in enumerate([(0, 0), (encoder.columns - columns, encoder.rows - rows)]):
        offset = low + torch.tensor(first) * encoder.pillar_m
        at = batch.boxes[i][:, :2] - offset
        inside = ((at >= 0) & (at < extent)).all(dim=1)
        expected = batch.boxes[i][inside].clone()
        expected[:, :2] -= torch.tensor(first) * encoder.pillar_m
        torch.testing.assert_close(boxes[i], expected)


def test_a_cut_batch_has_the_voxels_of_its_windows() -> None:
    network = network_of("pv-rcnn")
    area, backbone, size = network.site.area, network.backbone, network.config.voxel_m
    batch = make_batch([road_sample(1), road_sample(2)], area)
    step = network.bev.step * math.prod(network.config.strides)
    view = windows.view_of(looking_at(batch, 300.0, area.low[:2], area.high[:2]), area, size, step)
    voxels = backbone.voxels(windows.cut(batch, view, area, size), view)
    whole = backbone.voxels(batch).to_dense()
    rows, columns = view.sides
    parts = torch.stack([whole[0, :, :rows, :columns], whole[1, :, -rows:, -columns:]])
    assert parts.any(dim=(1, 2, 3)).all()
    # Moving a point can change its voxel because of rounding. This does not occur here.
    torch.testing.assert_close(voxels.to_dense(), parts, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", [*ON_PILLARS, "pv-rcnn"])
def test_a_window_over_the_whole_area_changes_nothing(name: str) -> None:
    network = network_of(name)
    batch = make_batch([road_sample(1)], network.site.area)
    whole = looking_at(batch, 1e6, (20.0, 0.0))
    for a, b in zip(network.losses(batch).values(), network.losses(whole).values(), strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize("name", ["pointpillars", "centerpoint-pillar", "pv-rcnn"])
def test_the_loss_of_a_vehicle_is_the_same_in_a_window(name: str) -> None:
    """The car is far from the border of the window. The loss of its cells does not depend on the
    window."""
    area = Area((-100.0, -80.0, SITE.area.low[2]), (100.0, 80.0, SITE.area.high[2]))
    network = network_of(name, Site(area, FLOOR_Z)).eval()
    car = np.array([[20.0, 0.3, FLOOR_Z + 0.8, 4.3, 1.85, 1.6, 0.1]])
    batch = make_batch([dataclasses.replace(road_sample(1), boxes=car)], area)
    whole = network.losses(batch)
    part = network.losses(looking_at(batch, 80.0 * 80, (20.0, 0.3)))
    torch.testing.assert_close(part["box"], whole["box"], atol=1e-4, rtol=1e-4)
    everywhere = next(iter(whole))  # scores or heat of all cells; a window has fewer cells
    assert part[everywhere] < whole[everywhere]


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("pointrcnn", {"window_m2": 100.0}, "window_m2: expected 0 for PointRCNN, got 100"),
        ("pointrcnn", {"balance": 0.5}, "balance: expected 0 for PointRCNN, got 0.5"),
        ("pointpillars", {"balance": 0.5}, "balance: expected 0 for PointPillars, got 0.5"),
        ("dsvt", {"window_m2": 100.0, "balance": 0.5}, None),
        ("pointrcnn", {}, None),
    ],
)
def test_windows_and_balance_are_asked_of_networks_that_support_them(
    name: str, values: dict[str, float], message: str | None, tmp_path: Path
) -> None:
    plain = read_recipe(ROOT / f"configs/detectors/{name}.yaml", "smoke")
    learning = dataclasses.replace(plain.learning, steps=1, batch=1, window_m2=0.0, balance=0.0)
    recipe = dataclasses.replace(plain, learning=dataclasses.replace(learning, **values))
    sample = road_sample(1)
    source = Source(
        *("lidar", "datasheet", "scene", "scan"),
        clouds=(lambda: sample.points,),
        read_boxes=lambda: (sample.boxes,),
        ground=level_ground(0.0),
    )
    if message is None:
        train(recipe, [source], tmp_path, quiet=True)
        return
    with pytest.raises(ValueError, match=f"learning.{message}"):
        train(recipe, [source], tmp_path, quiet=True)


def test_without_vehicles_a_window_lies_anywhere_in_the_area() -> None:
    empty = dataclasses.replace(road_sample(1), boxes=np.empty((0, 7)))
    draw = np.random.default_rng(1)
    centres = np.array([windows.centre_of(empty, SITE.area, draw) for _ in range(100)])
    assert (centres >= SITE.area.low[:2]).all()
    assert (centres < SITE.area.high[:2]).all()
    assert np.ptp(centres, axis=0).min() > 0.8 * min(SITE.area.size[:2])
