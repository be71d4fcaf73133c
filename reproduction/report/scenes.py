"""Checks whether a report covers the study's scenes."""

from pyinfra.dataset.catalogue import SCENES
from pyinfra.viz.report.report_data import Material


def are_of_the_paper(material: Material) -> bool:
    """Returns True if the results have a scene of the paper, or if they name no scene."""
    names = material.scenes()
    return not names or any(scene in SCENES for scene in names)
