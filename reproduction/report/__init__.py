"""Sections of the study's report: `pyinfra report RESULTS --sections reproduction.report`."""

from pyinfra.viz.report import contents, sections
from pyinfra.viz.report.contents import Maker
from reproduction.report import accuracy, hits, methods

# Maps a section of pyinfra's report to the study's version of the section.
_OF_THE_STUDY: dict[Maker, Maker] = {
    sections.hits.section: hits.section,
    sections.accuracy.section: accuracy.section,
    sections.methods.section: methods.section,
}

SECTIONS = [_OF_THE_STUDY.get(maker, maker) for maker in contents.SECTIONS]
