"""The detectors by name; a new detector needs a file and a row here."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """Module and class of a detector. A module also has a class `Config`.

    learnt: whether the detector is a network that is trained.
    """

    module: str
    name: str
    learnt: bool = True


DETECTORS = {
    "background": Entry("pyinfra.models.detectors.background", "Background", learnt=False),
    "pointpillars": Entry("pyinfra.models.detectors.pointpillars", "PointPillars"),
    "pointrcnn": Entry("pyinfra.models.detectors.pointrcnn", "PointRCNN"),
    "pointrcnn-remedied": Entry("pyinfra.models.detectors.pointrcnn", "PointRCNN"),
    "centerpoint-pillar": Entry("pyinfra.models.detectors.centerpoint_pillar", "CenterPointPillar"),
    "dsvt": Entry("pyinfra.models.detectors.dsvt", "Dsvt"),
    "pv-rcnn": Entry("pyinfra.models.detectors.pv_rcnn", "PvRcnn"),
}
