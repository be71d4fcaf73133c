"""DSVT: Dynamic Sparse Voxel Transformer with Rotated Sets, Wang et al., CVPR 2023, on pillars.

Deviations from the paper:

- one class; the area is chosen to include the vehicles of the training frames
- each layer uses the position embedding of the window in which it attends; in the published code
  every second layer uses the embedding of the other window
- the embedding is normalised over the cells of a window, not over the voxels
- one branch of the head predicts the whole box; its loss has the weight 0.5 instead of 2
- Gaussians are aligned with the vehicles (centre_head.py)
- the overlap loss is 1 minus the IoU of rotated boxes, without the distance of their centres
- the learning rate cycle and the non-maximum suppression (IoU 0.1) are those of all detectors of
  this package
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.core.config import ruled
from pyinfra.core.errors import Error
from pyinfra.models.detectors.batch import Batch, CanvasPart
from pyinfra.models.detectors.bev import BevNetwork, conv
from pyinfra.models.detectors.bev_config import BevConfig, multiple
from pyinfra.models.detectors.centre_head import CentreHead
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.distributed import LocalNorm
from pyinfra.models.detectors.head_settings import BOX
from pyinfra.models.detectors.losses import start_rare
from pyinfra.models.detectors.network import Losses, Network
from pyinfra.models.detectors.pillars import PillarEncoder
from pyinfra.models.detectors.suppression import MIN_SCORE
from pyinfra.models.detectors.windows import view_of
from pyinfra.models.ops.boxes import iou_3d_pairs
from pyinfra.models.ops.sets import Sets, partition, windows_of
from pyinfra.models.ops.triton_layers import LARGEST_HEAD, LARGEST_SET, set_attention, usable

OVERLAP_WEIGHT = 2.0


@dataclass(frozen=True)
class Config:
    """Sizes of the network; the defaults are the published sizes."""

    pillar_m: float = ruled(0.32, 0.05, 2)  # side of a pillar
    point_layers: int = ruled(2, 1, 4)  # layers of the pillar encoder
    width: int = ruled(192, 2, 1024)  # channels of a pillar
    blocks: int = ruled(4, 1, 16)  # number of attention blocks
    heads: int = ruled(8, 1, 64)  # number of heads of each attention
    feed_width: int = ruled(384, 1, 4096)  # channels between the two layers after an attention
    set_size: int = ruled(36, 1, 1024)  # largest number of pillars that attend to each other
    windows: tuple[int, ...] = ruled((12, 24), 1, 1024)  # window sides in cells; blocks alternate
    shifts: tuple[int, ...] = ruled((0, 6), 0, 1024)  # shifts of the windows, in cells
    bev: BevConfig = field(
        default_factory=lambda: BevConfig((1, 2, 2), (128, 128, 256), (1, 2, 2), 128)
    )
    head_width: int = ruled(64, 1, 512)  # channels of each branch of the head
    iou_share: float = ruled(0.68, 0, 1)  # exponent of the predicted IoU in the score of a box

    def __post_init__(self) -> None:
        if self.width % self.heads != 0 or self.width % 2 != 0:
            raise Error(
                f"width: expected an even number that heads ({self.heads}) divides, "
                f"got {self.width}"
            )
        if not 0 < len(self.windows) == len(self.shifts):
            lengths = f"{len(self.windows)} and {len(self.shifts)}"
            raise Error(f"windows, shifts: expected lists of equal lengths, got lengths {lengths}")


class Embedding(nn.Module):
    """Computes a learnt embedding of each cell in a window: (side * side, width), row by row."""

    def __init__(self, side: int, width: int) -> None:
        super().__init__()
        cell = torch.arange(side) - side / 2
        positions = torch.cartesian_prod(cell, cell).flip(1)  # x y of each cell
        self.register_buffer("positions", positions, persistent=False)
        norm = LocalNorm(width) if side > 1 else nn.Identity()
        self.layers = nn.Sequential(nn.Linear(2, width), norm, nn.ReLU(), nn.Linear(width, width))

    def forward(self) -> Tensor:
        embedded: Tensor = self.layers(self.positions)
        return embedded


class SetAttention(nn.Module):
    """Attention of voxels (n, width) to the voxels of their own set."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query_key = nn.Linear(width, 2 * width)
        self.value = nn.Linear(width, width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, position: Tensor, sets: Sets) -> Tensor:
        """Returns the attention of voxels: (n, width). x, position: (n, width).

        Voxels are projected before they are gathered into sets, so that a repeated voxel is
        projected only once.
        """
        projected = torch.cat([self.query_key(x + position), self.value(x)], dim=1)
        attended: Tensor
        if self.in_triton(projected, sets):
            attended = self.out(set_attention(projected, sets.voxel, sets.repeats, self.heads))
            return attended
        gathered = projected.index_select(0, sets.voxel.flatten())
        shape = (*sets.voxel.shape, 3, self.heads, x.shape[1] // self.heads)
        query, key, value = gathered.view(shape).permute(2, 0, 3, 1, 4)  # (s, heads, size, C)
        # An additive mask is faster than a boolean mask. The mask never hides a whole set, because
        # the first slot of a set does not repeat a voxel.
        hidden = query.new_zeros(sets.repeats.shape).masked_fill(sets.repeats, -torch.inf)
        attention_out = functional.scaled_dot_product_attention(
            query, key, value, attn_mask=hidden[:, None, None, :]
        )
        attention_out = attention_out.transpose(1, 2).reshape(-1, x.shape[1])  # (s * size, width)
        attended = self.out(attention_out.index_select(0, sets.slot))
        return attended

    def in_triton(self, projected: Tensor, sets: Sets) -> bool:
        """Returns whether a Triton kernel computes the attention; it needs no gathered array."""
        head = projected.shape[1] // 3 // self.heads
        small = sets.voxel.shape[1] <= LARGEST_SET and head <= LARGEST_HEAD
        return small and usable(projected) and not torch.compiler.is_compiling()


class Layer(nn.Module):
    """Attention in sets, then two linear layers; both steps have a residual connection."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        width = config.width
        self.attention = SetAttention(width, config.heads)
        self.feed = nn.Sequential(
            nn.Linear(width, config.feed_width), nn.GELU(), nn.Linear(config.feed_width, width)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(3))

    def forward(self, x: Tensor, position: Tensor, sets: Sets) -> Tensor:
        y = self.norms[0](x + self.attention(x, position, sets))
        y = self.norms[1](y + self.feed(y))
        around: Tensor = self.norms[2](x + y)
        return around


class DsvtBlock(nn.Module):
    """Two layers in the same windows. The first layer has sets along x, the second along y."""

    def __init__(self, config: Config, side: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Layer(config) for _ in range(2))
        self.embeddings = nn.ModuleList(Embedding(side, config.width) for _ in range(2))
        self.norm = nn.LayerNorm(config.width)

    def forward(self, x: Tensor, by_row: Tensor, rotated: tuple[Sets, Sets]) -> Tensor:
        """Returns features (n, width). by_row: (n,) index of each voxel's cell in its window."""
        y = x
        for layer, embedding, sets in zip(self.layers, self.embeddings, rotated, strict=True):
            y = layer(y, functional.embedding(by_row, embedding()), sets)
        around: Tensor = self.norm(x + y)
        return around


class Transformer(nn.Module):
    """Maps voxels (n, width) to (n, width); blocks alternate between the sizes of windows."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config = config
        sides = [config.windows[i % len(config.windows)] for i in range(config.blocks)]
        self.blocks = nn.ModuleList(DsvtBlock(config, side) for side in sides)
        for parameter in self.parameters():
            if parameter.dim() > 1:
                nn.init.xavier_uniform_(parameter)

    def forward(self, x: Tensor, frame: Tensor, row: Tensor, column: Tensor) -> Tensor:
        """Returns features (n, width). frame, row, column: (n,) of each voxel; n is 1 or more."""
        kinds = []
        for side, shift in zip(self.config.windows, self.config.shifts, strict=True):
            windows = windows_of(frame, row, column, side, shift)
            along = (windows.by_row, windows.by_column)
            along_x, along_y = (partition(windows, p, self.config.set_size) for p in along)
            kinds.append((windows.by_row, (along_x, along_y)))
        for i, block in enumerate(self.blocks):
            x = block(x, *kinds[i % len(kinds)])
        return x


class IouHead(CentreHead):
    """A centre head with a ninth number per box, the predicted IoU, scaled to -1 to 1."""

    def __init__(
        self, channels: int, width: int, site: Site, cell_m: float, iou_share: float
    ) -> None:
        super().__init__(channels, width, site, cell_m)
        self.iou_share = iou_share
        heat, box, iou = (nn.Conv2d(width, n, 3, padding=1) for n in (1, BOX, 1))
        self.heat = nn.Sequential(conv(width, width), start_rare(heat))
        self.box = nn.Sequential(conv(width, width), box)
        self.iou = nn.Sequential(conv(width, width), iou)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the heatmap as logits (B, 1, H, W), and the boxes (B, H, W, 9)."""
        x = self.shared(x)
        residuals = torch.cat([self.box(x), self.iou(x)], dim=1)
        return self.heat(x).float(), residuals.permute(0, 2, 3, 1).float()

    def box_losses(
        self, at: Tensor, boxes: Tensor, row: Tensor, column: Tensor, weights: Tensor
    ) -> Losses:
        overlap = iou_3d_pairs(self.decode(at, row, column), boxes)
        fit = (at[:, BOX] - (2 * overlap.detach() - 1)).abs()
        return {
            **super().box_losses(at, boxes, row, column, weights),
            "overlap": OVERLAP_WEIGHT * (weights * (1 - overlap)).sum(),
            "fit": (weights * fit).sum(),
        }

    def score(self, heat: Tensor, at: Tensor) -> Tensor:
        """Returns the scores (k,). A low predicted IoU reduces a score.

        Source: AFDetV2, Hu et al., AAAI 2022. The predicted IoU is trained at vehicles only, so it
        is not used where the heat is below MIN_SCORE.
        """
        fit = ((at[:, BOX] + 1) / 2).clamp(0, 1)
        score = heat ** (1 - self.iou_share) * fit**self.iou_share
        return torch.where(heat < MIN_SCORE, heat, score)


class Dsvt(Network):
    """The network DSVT: pillars, attention between them, a 2-D network and a centre head."""

    learns_in_windows = True
    balances_frames = True

    def __init__(self, config: Config, site: Site) -> None:
        area = site.area.grown(multiple(config.bev, config.pillar_m))
        super().__init__(Site(area, site.floor_z))
        width = config.width
        self.encoder = PillarEncoder(area, config.pillar_m, width, layers=config.point_layers)
        self.transformer = Transformer(config)
        self.bev = BevNetwork(config.bev, width, residual=True)
        cell_m = config.bev.strides[0] * config.pillar_m
        channels, share = self.bev.channels, config.iou_share
        self.head = IouHead(channels, config.head_width, self.site, cell_m, share)

    def canvas(self, batch: Batch, view: CanvasPart | None = None) -> Tensor:
        """Returns the canvas (B, C, H, W), or the part of it in `view`."""
        features, pillar = self.encoder.occupied(batch)  # features (n, width), pillars (n,)
        if view is not None:
            in_view = self.encoder.seen(pillar, view)
            features, pillar = features[in_view], pillar[in_view]
        if len(pillar) > 0:
            features = self.transformer(features, *self.encoder.cells_of(pillar))
        return self.encoder.canvas(features, pillar, batch.size, view)

    def losses(self, batch: Batch) -> Losses:
        view = view_of(batch, self.site.area, self.encoder.pillar_m, self.bev.step)
        canvas = self.bev(self.canvas(batch, view))
        return self.head.losses(canvas, view.boxes, view.classes, batch.balance)

    def candidates(self, batch: Batch) -> list[tuple[Tensor, ...]]:
        return self.head.candidates(self.bev(self.canvas(batch)))
