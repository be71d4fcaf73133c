"""The detectors by name: a new one is a file and a row here."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """Module and class; `learnt` networks have a `Config` beside the class and are trained."""

    module: str
    name: str
    learnt: bool = True


DETECTORS = {
    "background": Entry("pyinfra.detectors.background", "Background", learnt=False),
    "pointpillars": Entry("pyinfra.detectors.pointpillars", "PointPillars"),
    "pointrcnn": Entry("pyinfra.detectors.pointrcnn", "PointRCNN"),
    "pointrcnn-remedied": Entry("pyinfra.detectors.pointrcnn", "PointRCNN"),
    "centerpoint-pillar": Entry("pyinfra.detectors.centerpoint_pillar", "CenterPointPillar"),
    "dsvt": Entry("pyinfra.detectors.dsvt", "Dsvt"),
    "pv-rcnn": Entry("pyinfra.detectors.pv_rcnn", "PvRcnn"),
}
