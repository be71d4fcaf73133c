"""The tiles of a map: they contain all needed cells, and compute what these depend on."""

import numpy as np
import pytest

from pyinfra.core.arrays import BoolArray
from pyinfra.models.detectors.bev_config import BevConfig
from pyinfra.models.onnx.tiles import receptive_cells, tiles_of

SMALL = BevConfig(layers=(1, 1), widths=(8, 8), strides=(2, 2))  # 8 cells around each


def cross(size: int = 96, half: int = 3) -> BoolArray:
    """Returns a map whose needed cells are two strips that cross in the middle."""
    near = np.abs(np.arange(size) - size / 2) < half
    return np.asarray(near[:, None] | near)


@pytest.mark.parametrize("needed", [cross(), cross(24, 12), np.eye(64, dtype=bool)])
def test_tiles_use_each_needed_cell_once_and_compute_around_it(needed: BoolArray) -> None:
    halo, count = receptive_cells(SMALL), np.zeros(needed.shape, int)
    tiles = tiles_of(needed, SMALL)
    for tile in tiles:
        count[tuple(extent.used for extent in tile)] += 1
        for extent, size in zip(tile, needed.shape, strict=True):
            part, whole = extent.used, extent.computed
            # The receptive field is rounded up to steps of 2 cells.
            assert max(0, part.start - halo) <= whole.start <= max(0, part.start - halo + 2)
            assert min(size, part.stop + halo - 2) <= whole.stop <= min(size, part.stop + halo)
    assert (count[needed] == 1).all()
    assert count.max() == 1


def test_a_cross_is_less_to_compute_than_its_square() -> None:
    needed = cross(400, 12)
    cells = sum(
        (rows.computed.stop - rows.computed.start)
        * (columns.computed.stop - columns.computed.start)
        for rows, columns in tiles_of(needed, SMALL)
    )
    assert cells < 0.5 * needed.size


def test_no_needed_cell_has_no_tile() -> None:
    assert tiles_of(np.zeros((16, 8), bool), SMALL) == []


@pytest.mark.parametrize(
    "bev", [SMALL, BevConfig(layers=(2, 3, 3), widths=(4, 4, 4), strides=(2, 2, 2), up_width=4)]
)
def test_values_depend_on_no_cell_beyond_the_receptive_field(bev: BevConfig) -> None:
    torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
    from pyinfra.models.detectors.bev import BevNetwork

    torch.manual_seed(2)
    step = 2 * int(np.prod(bev.strides[1:]))
    size = 4 * receptive_cells(bev) + 4 * step
    network = BevNetwork(bev, 3).eval()
    canvas = torch.rand(1, 3, 2 * size, 2 * size, requires_grad=True)
    at = size // 2 // step * step  # a cell at the border of a step
    network(canvas)[0, :, at, at].sum().backward()
    touched = np.flatnonzero(canvas.grad.abs().sum(dim=(0, 1, 2)).numpy()) // 2
    assert at - touched.min() <= receptive_cells(bev)
    assert touched.max() - at <= receptive_cells(bev)
