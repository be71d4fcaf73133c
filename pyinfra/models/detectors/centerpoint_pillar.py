"""CenterPoint on pillars: Center-based 3D Object Detection and Tracking, Yin et al., CVPR 2021.

Deviations from the paper:

- dynamic pillars with one layer (pillars.py)
- one head for all classes, and no second stage
- Gaussians are aligned with the vehicles, the head has fewer layers, and the box loss has another
  weight (centre_head.py)
- pillars are 0.2 m wide, and the grid of boxes has half their resolution
"""

from torch import Tensor

from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.batch import Batch
from pyinfra.models.detectors.bev import BevNetwork
from pyinfra.models.detectors.bev_config import multiple
from pyinfra.models.detectors.centerpoint_config import Config
from pyinfra.models.detectors.centre_head import AxisHead, CentreHead
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.network import Losses, Network
from pyinfra.models.detectors.pillars import PillarEncoder
from pyinfra.models.detectors.windows import view_of


class CenterPointPillar(Network):
    """The network CenterPoint: pillars, a two-dimensional network and a centre head."""

    learns_in_windows = True
    balances_frames = True

    def __init__(self, config: Config, site: Site) -> None:
        area = site.area.grown(multiple(config.bev, config.pillar_m))
        super().__init__(Site(area, site.floor_z))
        self.classes = config.classes
        self.columns = config.columns
        looks_at = {"intensity": config.intensity, "with_xy": config.place, "age": config.age}
        self.encoder = PillarEncoder(area, config.pillar_m, config.pillar_width, **looks_at)
        self.bev = BevNetwork(config.bev, config.pillar_width)
        cell_m = config.bev.strides[0] * config.pillar_m
        head = AxisHead if config.axis else CentreHead
        self.head = head(self.bev.channels, config.head_width, self.site, cell_m, config.classes)

    def losses(self, batch: Batch) -> Losses:
        view = view_of(batch, self.site.area, self.encoder.pillar_m, self.bev.step)
        canvas = self.bev(self.encoder(batch, view))
        return self.head.losses(canvas, view.boxes, view.classes, batch.balance)

    def know(self, region: Region) -> None:
        if isinstance(self.head, AxisHead):
            low, high = self.site.area.low, self.site.area.high
            columns, rows = (round((high[i] - low[i]) / self.head.cell_m) for i in (0, 1))
            self.head.know(region, (rows, columns))

    def candidates(self, batch: Batch) -> list[tuple[Tensor, ...]]:
        return self.head.candidates(self.bev(self.encoder(batch)))
