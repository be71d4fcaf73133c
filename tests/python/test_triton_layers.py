"""The layers in Triton give the results and gradients of their twins in PyTorch.

They run on a GPU, or on a CPU with Triton's interpreter (TRITON_INTERPRET=1).
"""

import os

import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from torch import Tensor  # noqa: E402
from torch.nn import functional  # noqa: E402

from pyinfra.models.ops import rulebooks, sparse, triton_kernels, triton_layers  # noqa: E402
from pyinfra.models.ops.sets import partition, windows_of  # noqa: E402

INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1" and triton_kernels.enabled
needs_triton = pytest.mark.skipif(
    not (INTERPRETED or torch.cuda.is_available()), reason="no GPU and no interpreter of Triton"
)
DEVICE = "cpu" if INTERPRETED else "cuda"
SHAPE = (6, 20, 17)


def voxels(count: int) -> Tensor:
    cells = torch.randperm(2 * 6 * 20 * 17, generator=torch.Generator().manual_seed(3))[:count]
    z, y, x = cells // 340 % 6, cells // 17 % 20, cells % 17
    return torch.stack([cells // 2040, z, y, x], dim=1).to(DEVICE)


def random(*shape: int) -> Tensor:
    values = torch.randn(*shape, generator=torch.Generator().manual_seed(len(shape)))
    return values.to(DEVICE).requires_grad_()


def results(layer: torch.nn.Module, x: Tensor, *args: object) -> list[Tensor]:
    """Returns the output of a layer and the gradients of its input and weight."""
    out = layer(x, *args)
    weights = torch.linspace(-1, 1, out.numel(), device=out.device).view_as(out)
    return [out.detach(), *torch.autograd.grad((out * weights).sum(), [x, *layer.parameters()])]


class Convolution(torch.nn.Module):
    def __init__(self, c_in: int, c_out: int, offsets: int) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(random(offsets, c_in, c_out).detach())

    def forward(self, x: Tensor, rulebook: rulebooks.Rulebook | rulebooks.Table) -> Tensor:
        return sparse.convolve(x, self.weight, rulebook)


@needs_triton
@pytest.mark.parametrize(("c_in", "c_out"), [(4, 16), (32, 24)])
@pytest.mark.parametrize("strided", [False, True])
def test_a_table_on_a_gpu_convolves_as_a_rulebook(c_in: int, c_out: int, strided: bool) -> None:
    at, kernel = voxels(300), (3, 3, 3)
    if strided:
        geometry = (at, SHAPE, kernel, (2, 2, 2), (1, 1, 1))
        rulebook, table = rulebooks.strided_rulebook(*geometry), rulebooks.strided_table(*geometry)
    else:
        rulebook = rulebooks.submanifold_rulebook(at, SHAPE, kernel)
        table = rulebooks.submanifold_table(at, SHAPE, kernel)
    assert torch.equal(rulebook.target, table.target)
    layer, x = Convolution(c_in, c_out, 27), random(300, c_in)
    for one, two in zip(results(layer, x, rulebook), results(layer, x, table), strict=True):
        torch.testing.assert_close(two, one, atol=1e-3, rtol=1e-4)


@needs_triton
@pytest.mark.parametrize("size", [5, 36])
def test_attention_on_a_gpu_is_that_of_gathered_sets(size: int) -> None:
    at, heads, width = voxels(200), 2, 48
    windows = windows_of(at[:, 0], at[:, 2], at[:, 3], 8, 3)
    sets = partition(windows, windows.by_row, size)

    class Gathered(torch.nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            shape = (*sets.voxel.shape, 3, heads, width // heads)
            query, key, value = x[sets.voxel.flatten()].view(shape).permute(2, 0, 3, 1, 4)
            seen = ~sets.repeats[:, None, None, :]
            out = functional.scaled_dot_product_attention(query, key, value, attn_mask=seen)
            return out.transpose(1, 2).reshape(-1, width)[sets.slot]

    class InTriton(torch.nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            return triton_layers.set_attention(x, sets.voxel, sets.repeats, heads)

    x = random(200, 3 * width)
    for one, two in zip(results(Gathered(), x), results(InTriton(), x), strict=True):
        torch.testing.assert_close(two, one, atol=1e-4, rtol=1e-4)


@needs_triton
def test_maxima_on_a_gpu_are_those_of_a_scatter() -> None:
    owners = torch.tensor([0, 0, 0, 2, 2, 5] + [6] * 40, device=DEVICE)

    class Scattered(torch.nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            index = owners[:, None].expand_as(x)
            return x.new_zeros(20, x.shape[1]).scatter_reduce(0, index, torch.relu(x), "amax")

    class InTriton(torch.nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            return triton_layers.most_of_groups(torch.relu(x), owners, 20)

    x = random(46, 24)
    for one, two in zip(results(Scattered(), x), results(InTriton(), x), strict=True):
        torch.testing.assert_close(two, one)
