"""Sections of the study's report: `pyinfra report RESULTS --sections reproduction.report`."""

from pyinfra.viz.report.contents import Maker
from pyinfra.viz.report.sections import (
    answer,
    areas,
    distance,
    pictures,
    points,
    speed,
    stability,
    value,
    view,
)
from reproduction.report import accuracy, claims, fidelity, hits, methods
from reproduction.report.tables import TABLES

__all__ = ["SECTIONS", "TABLES"]

SECTIONS: list[Maker] = [
    answer.section,
    claims.section,
    hits.section,
    points.section,
    accuracy.section,
    distance.section,
    areas.section,
    value.section,
    speed.section,
    stability.section,
    fidelity.section,
    pictures.section,
    view.section,
    methods.section,
]
