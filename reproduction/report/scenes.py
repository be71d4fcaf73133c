"""Whether a report is of the study's scenes."""

from pyinfra.dataset.catalogue import SCENES
from pyinfra.viz.report.report_data import Material


def are_of_the_paper(material: Material) -> bool:
    """Whether a scene of the paper is among those of the results; true of no scene at all."""
    names = material.scenes()
    return not names or any(scene in SCENES for scene in names)
