"""Compares the kernels and layers in Triton with PyTorch on a GPU."""

from collections.abc import Callable

import torch

from pyinfra.models.ops import clouds, rulebooks, sparse, triton_kernels, triton_layers

SEED = 1


def same_kernels(device: torch.device) -> float:
    """Returns the share of equal results of the searches in points; 0 if a kernel fails."""
    generator = torch.Generator().manual_seed(SEED)
    counts = torch.tensor([20_000, 0, 7, 9000], device=device)
    size = torch.tensor([60.0, 40.0, 3.0])
    xyz = (torch.rand(int(counts.sum()), 3, generator=generator) * size).to(device)
    centres = xyz[::40].contiguous()
    of_centres = torch.bincount(clouds.cloud_of_rows(counts, xyz)[::40], minlength=4)

    def chosen() -> tuple[torch.Tensor, ...]:
        rows, _ = clouds.farthest_of_clouds(xyz, counts, 500)
        return rows, *clouds.neighbours(xyz, counts, centres, of_centres, 1.0, 16)

    try:
        pairs = zip(chosen(), _without_kernels(chosen), strict=True)
        return min(float((a == b).float().mean()) if len(a) == len(b) else 0.0 for a, b in pairs)
    except Exception as error:
        print(f"Triton: {type(error).__name__}: {error}", flush=True)
        return 0.0


def same_layers(device: torch.device) -> float:
    """Returns the share of equal features of the sparse convolution; 0 if any layer fails."""
    generator = torch.Generator().manual_seed(SEED)
    cells = torch.rand(5000, 3, generator=generator) * torch.tensor([10.0, 60, 60])
    at = torch.unique(torch.nn.functional.pad(cells.long(), (1, 0)), dim=0).to(device)
    shape, kernel = (10, 60, 60), (3, 3, 3)
    features = torch.rand(len(at), 64, generator=generator).to(device)
    weight = torch.rand(27, 64, 64, generator=generator).to(device)
    rows = torch.arange(len(at), device=device)
    try:
        rulebook = rulebooks.submanifold_rulebook(at, shape, kernel)
        table = rulebooks.submanifold_table(at, shape, kernel)
        by_rulebook, by_table = (sparse.convolve(features, weight, r) for r in (rulebook, table))
        same = float(((by_table / by_rulebook - 1).abs() < 1e-3).float().mean())
        sets = rows[: len(at) // 32 * 32].view(-1, 32)
        projected = torch.cat([features] * 3, dim=1).requires_grad_()
        attended = triton_layers.set_attention(projected, sets, sets < 0, 8)
        most = triton_layers.most_of_groups(attended.relu(), rows // 7, len(at))
        most.sum().backward()  # type: ignore[no-untyped-call]
        torch.cuda.synchronize()
        return same
    except Exception as error:
        print(f"Triton layers: {type(error).__name__}: {error}", flush=True)
        return 0.0


def _without_kernels(chosen: Callable[[], tuple[torch.Tensor, ...]]) -> tuple[torch.Tensor, ...]:
    triton_kernels.enabled = False
    try:
        return chosen()
    finally:
        triton_kernels.enabled = True
