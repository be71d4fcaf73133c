"""DSVT: the sets partition the voxels of a window, and attention stays within a set."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import SITE, road_sample  # noqa: E402
from torch import Tensor  # noqa: E402

from pyinfra.core.config import from_plain  # noqa: E402
from pyinfra.core.errors import ConfigError  # noqa: E402
from pyinfra.models.detectors.batch import make_batch  # noqa: E402
from pyinfra.models.detectors.dsvt import Config, Dsvt, IouHead, SetAttention, Transformer  # noqa: E402
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.ops.sets import Sets, VoxelWindows, partition, windows_of  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SIZE = 36
SMALL = Config(width=16, heads=4, feed_width=32)


def voxels(seed: int, count: int = 3000, frames: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Returns frame, row and column of different cells, in random order."""
    draw = np.random.default_rng(seed)
    cell = torch.from_numpy(draw.choice(frames * 60 * 90, count, replace=False))
    return cell // 5400, cell % 5400 // 90, cell % 90


def both(windows: VoxelWindows, size: int = SIZE) -> tuple[Sets, Sets]:
    return partition(windows, windows.by_row, size), partition(windows, windows.by_column, size)


def members(sets: Sets) -> list[list[int]]:
    """Returns the voxels of each set in order, without repetitions."""
    pairs = zip(sets.voxel, sets.repeats, strict=True)
    return [voxel[~repeats].tolist() for voxel, repeats in pairs]


def network_of(tier: str = "smoke") -> Dsvt:
    recipe = read_recipe(ROOT / "configs/detectors/dsvt.yaml", tier)  # type: ignore[arg-type]
    torch.manual_seed(1)
    return Dsvt(recipe.network, SITE).eval()


def test_windows_hold_the_cells_of_a_square_of_one_frame() -> None:
    frame, row, column = voxels(1)
    for side, shift in ((12, 0), (24, 6)):
        windows = windows_of(frame, row, column, side, shift)
        square = torch.stack([frame, (row + shift) // side, (column + shift) // side], dim=1)
        same_square = (square[:, None] == square).all(dim=2)
        same_window = windows.window[:, None] == windows.window
        assert torch.equal(same_square, same_window)
        for coordinate in (windows.row, windows.column):
            assert 0 <= int(coordinate.min()) <= int(coordinate.max()) < side


@pytest.mark.parametrize(("side", "shift"), [(12, 0), (24, 6)])
@pytest.mark.parametrize("size", [1, 5, 36, 1000])
def test_every_voxel_is_in_one_set_of_its_own_window(side: int, shift: int, size: int) -> None:
    windows = windows_of(*voxels(2), side, shift)
    for sets in both(windows, size):
        every = [voxel for one in members(sets) for voxel in one]
        assert sorted(every) == list(range(3000))
        assert sets.voxel.shape[1] == size
        assert (windows.window[sets.voxel] == windows.window[sets.voxel[:, :1]]).all()
        assert torch.equal(sets.voxel.flatten()[sets.slot], torch.arange(3000))
        assert not sets.repeats.flatten()[sets.slot].any()
        assert not sets.repeats[:, 0].any()


def test_a_window_has_no_more_sets_than_its_voxels_need_and_they_are_of_like_size() -> None:
    windows = windows_of(*voxels(3), 12, 0)
    for sets in both(windows):
        lengths = np.array([len(one) for one in members(sets)])
        window = windows.window[sets.voxel[:, 0]].numpy()
        for number in np.unique(window):
            in_window = lengths[window == number]
            assert len(in_window) == np.ceil(in_window.sum() / SIZE)
            assert in_window.max() - in_window.min() <= 1


def test_sets_are_strips_along_one_axis_and_then_along_the_other() -> None:
    row, column = torch.meshgrid(torch.arange(12), torch.arange(12), indexing="ij")
    row, column = row.flatten(), column.flatten()
    along_x, along_y = both(windows_of(torch.zeros_like(row), row, column, 12, 0))
    for sets, across, along in ((along_x, row, column), (along_y, column, row)):
        assert sets.voxel.shape == (4, SIZE)
        for i, one in enumerate(members(sets)):
            assert set(across[one].tolist()) == {3 * i, 3 * i + 1, 3 * i + 2}
            assert set(along[one].tolist()) == set(range(12))


def test_sets_do_not_depend_on_the_order_of_voxels() -> None:
    cells = torch.stack(voxels(4))
    order = torch.randperm(3000, generator=torch.Generator().manual_seed(1))
    for a, b in zip(
        both(windows_of(*cells, 24, 6)), both(windows_of(*cells[:, order], 24, 6)), strict=True
    ):
        assert torch.equal(a.voxel, order[b.voxel])
        assert torch.equal(a.repeats, b.repeats)


def test_a_window_may_hold_one_voxel_or_all() -> None:
    one = torch.zeros(1, dtype=torch.int64)
    lonely = both(windows_of(one, one, one, 12, 0))[0]
    assert members(lonely) == [[0]]
    frame, row, column = voxels(5, 500, 1)
    full = both(windows_of(frame, row, column, 100, 0))[0]
    assert len(full.voxel) == 14
    config = dataclasses.replace(SMALL, windows=(12, 100), shifts=(0, 0))
    transformer = Transformer(config).eval()
    for cells in ((one, one, one), (frame, row, column)):
        x = torch.randn(len(cells[0]), 16, generator=torch.Generator().manual_seed(1))
        assert torch.isfinite(transformer(x, *cells)).all()
        with torch.autocast("cpu", torch.bfloat16):  # in these sets, all voxels but one are masked
            assert torch.isfinite(transformer(x, *cells)).all()


def test_attention_in_a_set_is_that_of_its_voxels_without_the_repeats() -> None:
    torch.manual_seed(1)
    windows = windows_of(*voxels(6, 300), 12, 0)
    sets, attention = both(windows)[0], SetAttention(16, 4)
    x, position = torch.randn(300, 16), torch.randn(300, 16)
    attended = attention(x, position, sets)
    plain = torch.nn.MultiheadAttention(16, 4, batch_first=True)
    with torch.no_grad():
        plain.in_proj_weight.copy_(torch.cat([attention.query_key.weight, attention.value.weight]))
        plain.in_proj_bias.copy_(torch.cat([attention.query_key.bias, attention.value.bias]))
    plain.out_proj = attention.out
    for one in members(sets):
        at = (x + position)[None, one]
        wanted = plain(at, at, x[None, one])[0][0]
        torch.testing.assert_close(attended[one], wanted, atol=1e-5, rtol=1e-4)


def test_what_happens_in_a_set_or_a_frame_stays_there() -> None:
    torch.manual_seed(1)
    cells = voxels(7)
    windows = windows_of(*cells, 12, 0)
    sets, attention = both(windows)[0], SetAttention(16, 4)
    x, position = torch.randn(3000, 16), torch.zeros(3000, 16)
    changed = x.clone()
    first = members(sets)[0]
    changed[first[0]] += 1
    moved = (attention(x, position, sets) != attention(changed, position, sets)).any(dim=1)
    assert moved.nonzero()[:, 0].tolist() == sorted(first)

    transformer, other = Transformer(SMALL).eval(), cells[0] == 1
    changed = torch.where(other[:, None], x + 1, x)
    before, after = transformer(x, *cells), transformer(changed, *cells)
    torch.testing.assert_close(before[~other], after[~other], atol=1e-5, rtol=1e-5)
    assert (before[other] != after[other]).any()


def test_two_rotated_layers_let_voxels_of_other_sets_meet() -> None:
    row, column = torch.meshgrid(torch.arange(12), torch.arange(12), indexing="ij")
    cells = (torch.zeros(144, dtype=torch.int64), row.flatten(), column.flatten())
    torch.manual_seed(1)
    transformer = Transformer(dataclasses.replace(SMALL, blocks=1)).eval()
    x = torch.randn(144, 16, requires_grad=True)
    transformer(x, *cells)[0].square().sum().backward()
    assert x.grad is not None
    assert (x.grad.abs().sum(dim=1) > 0).all()


def test_a_place_in_a_window_counts() -> None:
    torch.manual_seed(1)
    transformer, x = Transformer(SMALL).eval(), torch.randn(2, 16)
    zero = torch.zeros(2, dtype=torch.int64)
    near, far = (transformer(x, zero, zero, torch.tensor([0, c])) for c in (1, 5))
    assert (near - far).abs().max() > 1e-3


def test_shuffled_points_give_the_same_boxes() -> None:
    network, points = network_of(), road_sample(8).points
    shuffled = np.random.default_rng(1).permutation(points)
    a, b = network.find([points])[0], network.find([shuffled])[0]
    np.testing.assert_allclose(a.boxes, b.boxes, atol=1e-3)
    np.testing.assert_allclose(a.scores, b.scores, atol=1e-4)


def test_a_batch_of_empty_frames_has_a_loss_and_no_box_of_its_own() -> None:
    network = network_of().train()
    nothing = Sample(np.empty((0, 4), np.float32), np.empty((0, 7)))
    batch = make_batch([nothing, nothing], network.site.area)
    total = torch.stack(list(network.losses(batch).values())).sum()
    assert torch.isfinite(total)
    total.backward()
    assert len(network.eval().candidates(batch)) == 2


def test_a_score_mixes_heat_and_fit_where_there_is_heat() -> None:
    head = IouHead(4, 4, SITE, 0.8, 0.68)
    at = torch.zeros(4, 9)
    at[:, 8] = torch.tensor([1.0, 0.0, -3.0, 1.0])
    heat = torch.tensor([0.5, 0.5, 0.5, 0.05])
    wanted = torch.tensor([0.5**0.32, 0.5, 0.0, 0.05])
    torch.testing.assert_close(head.score(heat, at), wanted)


def test_the_fit_learns_the_overlap_of_the_detected_box() -> None:
    head = IouHead(4, 4, SITE, 0.8, 0.68)
    boxes = torch.from_numpy(road_sample(9).boxes).float()
    row, column = head.cells_of(boxes, (32, 48))
    exact = torch.cat([head.encode(boxes, row, column), torch.ones(len(boxes), 1)], dim=1)
    for value in head.box_losses(exact, boxes, row, column, torch.ones(len(boxes))).values():
        assert float(value) == pytest.approx(0, abs=0.01)
    shifted = exact.clone()
    shifted[:, 3] += np.log(2)  # the box is twice as long, so half of it overlaps
    losses = head.box_losses(shifted, boxes, row, column, torch.ones(len(boxes)))
    assert float(losses["fit"]) == pytest.approx(len(boxes), abs=0.01)
    assert float(losses["overlap"]) == pytest.approx(len(boxes), abs=0.01)


def test_the_published_network_is_the_default_and_of_the_published_size() -> None:
    network = Dsvt(Config(), SITE)
    count = sum(p.numel() for p in network.transformer.parameters())
    assert count == pytest.approx(2.7e6, rel=0.02)
    assert read_recipe(ROOT / "configs/detectors/dsvt.yaml", "full").network == Config()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 20, "heads": 8}, "width"),
        ({"windows": [12]}, "windows, shifts"),
        ({"iou_share": 2}, "iou_share"),
    ],
)
def test_a_wrong_configuration_is_an_error(change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        from_plain(change, Config, "dsvt")
