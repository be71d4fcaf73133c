"""Training of one network in several processes, each with its share of every batch.

torch.distributed is used directly instead of DistributedDataParallel, because networks have
`losses` and no `forward`, and some parameters are not used in some batches. Apart from rounding,
the weights are the same as with one process. For this purpose, a loss is normalised by the number
of objects of the whole batch, or it is a mean over frames. Batch norms use the statistics of the
whole batch. They are not PyTorch's SyncBatchNorm, because SyncBatchNorm needs a GPU.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch import distributed as dist
from torch.nn import functional
from torch.nn.modules.batchnorm import _BatchNorm

from pyinfra.core.errors import Error


@contextmanager
def joined(device: torch.device) -> Iterator[torch.device]:
    """Connects the processes if torchrun started several; yields the device of this process.

    Raises Error if the user's device has a number, because each process uses another device.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield device
        return
    if ":" in str(device):
        raise Error(
            f"device: expected '{device.type}' without a number for several processes, got "
            f"'{device}'"
        )
    if device.type == "cuda":
        device = torch.device("cuda", int(os.environ["LOCAL_RANK"]))
        torch.cuda.set_device(device)
    dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield device
    finally:
        dist.destroy_process_group()


def check_batch(size: int) -> None:
    """Raises Error if a batch of this size cannot be divided equally among the processes."""
    if size % count() != 0:
        raise Error(
            f"learning.batch: expected a multiple of {count()}, the number of processes, got {size}"
        )


def rank() -> int:
    return dist.get_rank() if dist.is_initialized() else 0


def count() -> int:
    return dist.get_world_size() if dist.is_initialized() else 1


def of_all(number: Tensor) -> Tensor:
    """Returns the number by which the loss of a batch is divided.

    number: number of objects in this process's share of the batch. With one process, the result is
    this number, but at least 1. With several processes, the result is the number of objects of the
    whole batch divided by the number of processes. The mean of the processes' losses is then the
    loss of the whole batch.
    """
    if count() == 1:
        return number.clamp(min=1)
    total = number.detach().float()
    dist.all_reduce(total)
    return total.clamp(min=1) / count()


def mean(values: Tensor) -> Tensor:
    """Returns the mean of values over the processes, without gradient."""
    values = values.detach()
    if count() > 1:
        values = values.clone()
        dist.all_reduce(values)
        values /= count()
    return values


def average_gradients(network: nn.Module) -> None:
    """Averages the gradients over the processes.

    A parameter that no process used gets no gradient, so the optimiser does not change it.
    """
    if count() == 1:
        return
    parameters = [p for p in network.parameters() if p.requires_grad]
    used = torch.tensor([float(p.grad is not None) for p in parameters])
    flat = [(torch.zeros_like(p) if p.grad is None else p.grad).flatten() for p in parameters]
    sums = torch.cat([*flat, used.to(flat[0].device)])
    dist.all_reduce(sums)
    *parts, by_any = sums.split_with_sizes([*(p.numel() for p in parameters), len(parameters)])
    for parameter, part, by in zip(parameters, parts, by_any.tolist(), strict=True):
        parameter.grad = part.view_as(parameter) / count() if by > 0 else None


class LocalNorm(nn.BatchNorm1d):
    """Batch norm of values that are the same in all processes. `share_norms` does not change it."""


class _SharedNorm(_BatchNorm):
    """Batch norm over the batches of all processes, some of which may be empty."""

    def _check_input_dim(self, _: Tensor) -> None:
        pass

    def forward(self, x: Tensor) -> Tensor:
        if not self.training:
            return super().forward(x)
        around = [0, *range(2, x.dim())]
        wide = x.float()
        number = torch.tensor([x.numel() / x.shape[1]], device=x.device)
        sums = _summed(torch.cat([wide.sum(around), number]))
        n = sums[-1].item()
        if n < 2:  # the variance of fewer than two values is undefined
            mean, variance = self.running_mean, self.running_var
            return functional.batch_norm(x, mean, variance, self.weight, self.bias, eps=self.eps)
        shape = (1, -1, *[1] * (x.dim() - 2))
        middle = sums[:-1] / n
        away = wide - middle.view(shape)
        spread = _summed((away**2).sum(around)) / n
        self._remember(middle.detach(), spread.detach() * (n / (n - 1)))
        scale = self.weight * (spread + self.eps).rsqrt()
        return (away * scale.view(shape) + self.bias.view(shape)).to(x.dtype)

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor) -> None:
        share = cast(float, self.momentum)
        cast(Tensor, self.num_batches_tracked).add_(1)
        cast(Tensor, self.running_mean).lerp_(mean, share)
        cast(Tensor, self.running_var).lerp_(variance, share)


class _Sum(torch.autograd.Function):
    # The sum in each process depends on the inputs of all processes, so gradients are summed too.
    @staticmethod
    def forward(_: Any, x: Tensor) -> Tensor:
        total = x.clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(_: Any, *gradients: Tensor) -> Tensor:
        total = gradients[0].clone(memory_format=torch.contiguous_format)
        dist.all_reduce(total)
        return total


def _summed(x: Tensor) -> Tensor:
    """Returns the sum of x over the processes; its gradient is that of the sum of their losses."""
    return cast(Tensor, _Sum.apply(x))  # type: ignore[no-untyped-call]


def share_norms(network: nn.Module) -> None:
    """Makes batch norms use the whole batch if there are several processes.

    Weights do not change.
    """
    for module in network.modules():
        if count() > 1 and isinstance(module, _BatchNorm) and not isinstance(module, LocalNorm):
            module.__class__ = _SharedNorm
