"""The two-dimensional network on a bird's-eye canvas.

The network follows SECOND, Yan et al., Sensors 2018, as used in PointPillars. It consists of blocks
of 3 x 3 convolutions. Each block has half the resolution of the previous block. The outputs of the
blocks are upsampled to one resolution and concatenated.
"""

import math

import torch
from torch import Tensor, nn
from torch.autograd import Function
from torch.nn import functional

from pyinfra.models.detectors.bev_config import BevConfig


class BevNetwork(nn.Module):
    """Maps (B, C, H, W) to (B, blocks * up_width, H / s, W / s), where s is the first stride."""

    def __init__(self, config: BevConfig, channels: int, *, residual: bool = False) -> None:
        super().__init__()
        layer = Residual if residual else conv
        self.blocks, self.ups = nn.ModuleList(), nn.ModuleList()
        factor = 1
        for i, (n, width) in enumerate(zip(config.layers, config.widths, strict=True)):
            stride = config.strides[i]
            layers = [layer(channels, width, stride), *(layer(width, width) for _ in range(n))]
            self.blocks.append(nn.Sequential(*layers))
            factor *= stride if i > 0 else 1
            up = nn.ConvTranspose2d(width, config.up_width, factor, factor, bias=False)
            self.ups.append(nn.Sequential(up, norm(config.up_width), nn.ReLU()))
            channels = width
        self.channels = len(config.layers) * config.up_width
        self.step = math.prod(config.strides)  # the canvas's sides must be multiples of this
        # This memory layout makes the network a sixth faster on a CPU. The type stub of `to` lacks
        # this overload.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, x: Tensor) -> Tensor:
        upsampled = []
        for block, up in zip(self.blocks, self.ups, strict=True):
            x = block(x)
            upsampled.append(up(x))
        return torch.cat(upsampled, dim=1)


# Whether PlaneGradient is used. It was measured to be faster than PyTorch's gradient with AVX2; it
# was not measured with AVX-512.
PLANES_ARE_FASTER = torch.backends.cpu.get_cpu_capability() == "AVX2"


class PlaneGradient(Function):
    """A 3 x 3 convolution whose weight gradient is computed with one plane per channel in memory.

    For AVX2, oneDNN has no kernel of this gradient for the memory layout "channels last". Its
    fallback takes up to three times as long as its kernel for planes.
    """

    @staticmethod
    def forward(ctx, x: Tensor, weight: Tensor, stride: int) -> Tensor:  # type: ignore[no-untyped-def]
        ctx.save_for_backward(x, weight)
        ctx.stride = stride
        return functional.conv2d(x, weight, None, stride, padding=1)

    @staticmethod
    def backward(ctx, gradient: Tensor) -> tuple[Tensor, Tensor, None]:  # type: ignore[no-untyped-def]
        x, weight = ctx.saved_tensors
        # arguments: bias sizes, stride, padding, dilation, transposed, output padding, groups
        sizes = None, [ctx.stride] * 2, [1, 1], [1, 1], False, [0, 0], 1
        gradients = torch.ops.aten.convolution_backward
        of_x = gradients(gradient, x, weight, *sizes, [True, False, False])[0]
        planes = gradient.contiguous(), x.contiguous(), weight.contiguous()
        return of_x, gradients(*planes, *sizes, [False, True, False])[1], None


class Convolution(nn.Conv2d):
    """A 3 x 3 convolution without bias, which keeps the size if its stride is 1."""

    def __init__(self, channels: int, width: int, stride: int = 1) -> None:
        super().__init__(channels, width, 3, stride, padding=1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        learns = self.training and torch.is_grad_enabled() and not torch.is_autocast_enabled("cpu")
        if PLANES_ARE_FASTER and learns and x.device.type == "cpu":
            return PlaneGradient.apply(x, self.weight, self.stride[0])  # type: ignore[no-any-return, no-untyped-call]
        return super().forward(x)


def conv(channels: int, width: int, stride: int = 1) -> nn.Sequential:
    """3 x 3 convolution, batch norm, ReLU."""
    layer = Convolution(channels, width, stride)
    return nn.Sequential(layer, norm(width), nn.ReLU())


class Residual(nn.Module):
    """Two 3 x 3 convolutions with a residual connection (He et al., CVPR 2016)."""

    def __init__(self, channels: int, width: int, stride: int = 1) -> None:
        super().__init__()
        second = Convolution(width, width)
        self.through = nn.Sequential(*conv(channels, width, stride), second, norm(width))
        self.around: nn.Module = nn.Identity()
        if stride != 1 or channels != width:
            straight = nn.Conv2d(channels, width, 1, stride, bias=False)
            self.around = nn.Sequential(straight, norm(width))

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(self.through(x) + self.around(x))


def norm(width: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(width, eps=1e-3)
