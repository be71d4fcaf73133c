"""Fuses batch norms into the layers before them, which makes inference faster."""

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from pyinfra.models.detectors.network import Network
from pyinfra.models.detectors.pillars import PillarEncoder


def fused(network: Network) -> Network:
    """Fuses batch norms of a network in eval mode, in place, and returns the network.

    The fused batch norms are those after convolutions and after the last layer of a pillar encoder.
    If the network is on a GPU, activations after convolutions are fused, too. Boxes change by less
    than 1e-4 m, because of rounding. Only networks on pillars are changed. In other networks,
    rounding errors may change which points are sampled.
    """
    modules = list(network.modules())
    if not any(isinstance(module, PillarEncoder) for module in modules):
        return network
    for module in modules:
        if isinstance(module, nn.Sequential):
            _fuse_convolutions(module)
        elif isinstance(module, PillarEncoder):
            linear, norm = cast(nn.Linear, module.linear), cast(nn.BatchNorm1d, module.norm)
            module.linear = fuse_linear_bn_eval(linear, norm)
            module.norm = nn.Identity()
    return network


def _fuse_convolutions(layers: nn.Sequential) -> None:
    for i in range(1, len(layers)):
        layer, norm = layers[i - 1], layers[i]
        if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d) and isinstance(norm, nn.BatchNorm2d):
            turned = isinstance(layer, nn.ConvTranspose2d)
            layers[i - 1] = fuse_conv_bn_eval(layer, norm, turned)
            layers[i] = nn.Identity()
            if not turned and i + 1 < len(layers) and isinstance(layers[i + 1], nn.ReLU):
                _fuse_activation(layers, i - 1)


def _fuse_activation(layers: nn.Sequential, i: int) -> None:
    """Fuses the activation after a convolution on a GPU, where cuDNN computes both at once."""
    layer = cast(nn.Conv2d, layers[i])
    if layer.weight.is_cuda:
        layers[i], layers[i + 2] = ConvolutionRelu(layer), nn.Identity()


class ConvolutionRelu(nn.Module):
    """A convolution, its bias and ReLU in one kernel; only on a GPU, and without gradients."""

    def __init__(self, layer: nn.Conv2d) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, x: Tensor) -> Tensor:
        layer = self.layer
        padding, stride, dilation = (
            cast(tuple[int, int], sizes) for sizes in (layer.padding, layer.stride, layer.dilation)
        )
        result: Tensor = torch.cudnn_convolution_relu(
            x, layer.weight, layer.bias, stride, padding, dilation, layer.groups
        )
        return result
