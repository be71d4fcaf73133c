"""Writes the page of a benchmark, or the page of a plan again."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.experiments.requirements import Requirements, checked_requirements
from pyinfra.viz.page_file import check_file
from pyinfra.viz.plan_page.files import is_plan
from pyinfra.viz.plan_page.page import rewrite_plan_page
from pyinfra.viz.report.contents import page, read_sections
from pyinfra.viz.report.page import write_page
from pyinfra.viz.report.report_data import read_material

SECTIONS = "pyinfra.viz.report.contents"


def write_report(
    results: Path,
    out: Path,
    data: Sequence[Path] = (),
    runs: Sequence[Path] = (),
    tier: str | None = None,
    sections: str = SECTIONS,
    required: Mapping[str, float | None] | None = None,
) -> Path:
    """Writes a page, and returns its path.

    results: folder of the tables of a benchmark, or of a plan; for a plan, no other argument than
    `out` is allowed. sections: module whose list SECTIONS has the functions that write the
    sections. required: fields of `Requirements`; None stands for the default of a field. Raises
    Error for a folder without results.
    """
    check_file(out)
    given = {name: value for name, value in (required or {}).items() if value is not None}
    if is_plan(results):
        others = {"data": data, "runs": runs, "tier": tier, "sections": sections != SECTIONS}
        for name in [*(name for name, value in others.items() if value), *given]:
            raise Error(
                f"{name}: expected the results of a benchmark for this argument, got the plan "
                f"{results}; the page of a plan has its own controls"
            )
        return rewrite_plan_page(results, out)
    requirements = checked_requirements(**{**vars(Requirements()), **given})
    makers, tables = read_sections(sections)
    material = read_material(results, data, runs, tier, requirements, tables)
    return write_page(page(material, makers), out)
