"""Losses of detectors. The caller must divide a loss by the number of objects."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

RARE = 0.01  # initial probability of an object at each position


def start_rare(layer: nn.Conv2d) -> nn.Conv2d:
    """Sets the bias of a layer of logits so that all initial probabilities are RARE."""
    nn.init.constant_(layer.get_parameter("bias"), -math.log((1 - RARE) / RARE))
    return layer


def focal(logits: Tensor, targets: Tensor, alpha: float = 0.25, gamma: float = 2.0) -> Tensor:
    """Returns the focal loss (Lin et al., ICCV 2017) of each element; targets are 0 or 1."""
    p = torch.sigmoid(logits)
    wrong = torch.where(targets > 0.5, 1 - p, p)
    weight = torch.where(targets > 0.5, alpha, 1 - alpha)
    cross = functional.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    return weight * wrong**gamma * cross


def heat_map_focal(logits: Tensor, heat: Tensor) -> Tensor:
    """Returns the penalty-reduced focal loss (CornerNet, Law and Deng, ECCV 2018): (B,).

    The loss is summed over each frame. logits, heat: (B, H, W). heat is in [0, 1], and 1 at peaks.
    """
    p = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    peak = heat == 1
    at_peak = torch.log(p) * (1 - p) ** 2
    around = torch.log(1 - p) * p**2 * (1 - heat) ** 4
    return -torch.where(peak, at_peak, around).sum(dim=(1, 2))


def smooth_l1(predicted: Tensor, wanted: Tensor, beta: float = 1 / 9) -> Tensor:
    """Returns the smooth L1 loss of each element."""
    return functional.smooth_l1_loss(predicted, wanted, reduction="none", beta=beta)
