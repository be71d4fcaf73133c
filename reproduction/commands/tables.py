"""Writes the tables and answers of the documentation from the CSV files in results/: `make docs`.

In a page, a table is between `<!-- table NAME -->` and `<!-- end -->`. TABLES maps each NAME to the
function that makes the table. Below the table, a sentence names the frames on which it rests.
Likewise, TEXTS has the paragraphs between `<!-- text NAME -->` and `<!-- end -->`. `--check` writes
nothing and fails if a table or text in a page differs from the result of its function. The first
figures of the pages of results are drawn again if their rows have changed.
"""

import re
import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pyinfra.core.errors import Error
from reproduction import ROOT
from reproduction.arguments import command
from reproduction.tables import (
    catalogue,
    figures,
    findings,
    formats,
    frame_numbers,
    front_page,
    goals,
    gpu,
    integration,
    label_times,
    measure,
    networks,
    placement,
    rungs,
    sentences,
    sentences_of_models,
    sentences_of_poles,
    simulator,
    sites,
    steps,
    stress,
    tracks,
    verdicts,
    versions,
)
from reproduction.tables.common import frames_of_results, with_frames

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
BLOCK = re.compile(r"(<!-- (table|text) (.+?) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
PICTURES = ROOT / "docs/pictures/results"
LINE = 200  # maximum length of a line of a page

TABLES: dict[str, Callable[[], str]] = {
    "three findings": front_page.findings,
    "claims in short": findings.in_short,
    "claims about scanning": findings.scanning,
    "AP of captured": verdicts.average_precision,
    "verdicts, comparable": partial(verdicts.verdicts, "comparable"),
    "verdicts, comparable on common": partial(verdicts.verdicts, "comparable", "common"),
    "verdicts, 64-below": partial(verdicts.verdicts, "64-below"),
    "verdicts, gentle": partial(verdicts.verdicts, "gentle"),
    "verdicts, areas": partial(verdicts.verdicts, "areas"),
    "verdicts, value": partial(verdicts.verdicts, "value", "present"),
    "law of range": verdicts.law_of_range,
    "value, paper": partial(verdicts.value, "paper"),
    "value, datasheet": partial(verdicts.value, "datasheet"),
    "gain by fine-tuning": verdicts.bias,
    "label times": label_times.label_times,
    "cut angles": label_times.cut_angles,
    "cut angles of the training": label_times.training_cut_angles,
    "comparison at label times": label_times.comparison,
    "integration time": integration.integration,
    "integration time, all vehicles": partial(integration.integration, "present"),
    "variance": verdicts.variance,
    "seeds": verdicts.seeds,
    "cost of the trainings": verdicts.costs,
    "verdicts decided": verdicts.decided,
    "speed": simulator.speed,
    "ladder": simulator.ladder,
    "models of a LiDAR": rungs.rungs,
    "one ray by LiDAR": rungs.rungs_by_lidar,
    "beams in AP": rungs.rungs_ap,
    "points per vehicle, frames 3 and 4": frame_numbers.frame_numbers,
    "catalogue": catalogue.catalogue,
    "growth": simulator.growth,
    "coverage": measure.coverage,
    "correlation": measure.correlation,
    "people": sites.people,
    "poles": sites.poles,
    "pole points": sites.pole_points,
    "places": sites.places,
    "pole errors": sites.pole_errors,
    "detector latency": networks.detector_latency,
    "onnx files": networks.onnx_files,
    "generalist": networks.generalist,
    "compared with site-trained detectors": networks.compared_with_site_trained,
    "stress": stress.stress,
    "detector goals": goals.goals,
    "detector pilots": goals.pilots,
    "unseen": networks.unseen,
    "unseen pose": networks.unseen_pose,
    "unseen shown": networks.unseen_shown,
    "fairness": networks.fairness,
    "traffic": sites.traffic,
    "generalist at sites": networks.generalist_sites,
    "generalist by class": networks.generalist_classes,
    "sites": sites.sites,
    "predictors of AP": placement.predictors,
    "errors of the prediction": placement.errors,
    "predictors by traffic": placement.by_traffic,
    "reliability": placement.reliability,
    "what a place is worth": partial(placement.placement, "place"),
    "order of LiDARs over poses": partial(placement.placement, "order"),
    "answers of plans": placement.answers,
    "plans": placement.plans,
    "plan coverage": placement.plan_coverage,
    "times of plans": placement.plan_times,
    "16 lines or 128": partial(placement.placement, "units"),
    "detectors on the highway, paper": partial(verdicts.detectors, "highway", "paper"),
    "detectors on the highway, datasheet": partial(verdicts.detectors, "highway", "datasheet"),
    "tracks": tracks.measures,
    "tracked passages": tracks.passages,
    "tracks of true boxes": tracks.true_boxes,
    "times of tracking": tracks.times,
    "live tracking": tracks.follow,
    "GPU rates": gpu.rates,
    "GPU latency": gpu.detection,
    "GPU batches": gpu.batches,
    "GPU hours": gpu.hours,
    "GPU and CPU": gpu.accuracy,
    "CPU rates of training": gpu.rates_of_cpu,
    "claims about detectors": verdicts.claims_of_detectors,
}
FRAMES: dict[str, Callable[[], str]] = {  # tables without a sentence about the version of frames
    "frames of the results": frames_of_results,
    "steps": steps.steps,
    "other files": steps.others,
    "changes of verdicts": versions.counts,
    "changed verdicts on detection": versions.detection,
    "changed verdicts on scanning": versions.scanning,
    "catalogue, sources": catalogue.sources,
    "formats": formats.formats,
    "other formats": formats.other_formats,
}


TEXTS: dict[str, Callable[[], str]] = {
    "areas": sentences.areas,
    "comparable": sentences.comparable,
    "detector decides": sentences.detector_decides,
    "64 lines": sentences.lines_64,
    "distance": sentences.distance,
    "value": sentences.value,
    "detectors": sentences.detectors,
    "claims about detectors": sentences.claims_of_detectors,
    "points": sentences.points,
    "motor": sentences.motor,
    "intervals": measure.intervals,
    "seeds": sentences.seeds,
    "fidelity": sentences_of_models.fidelity,
    "failures": sentences_of_models.failures,
    "integration": sentences_of_models.integration,
    "label times": sentences_of_models.label_times,
    "placement": sentences_of_models.placement,
    "plan intervals": sentences_of_models.plan_intervals,
    "models of a LiDAR": sentences_of_models.lidar_models,
    "tracks": sentences_of_models.tracks,
    "live tracking": sentences_of_models.follow,
    "people": sentences_of_models.people,
    "places": sentences_of_poles.places,
    "poles": sentences_of_poles.poles,
    "pole errors": sentences_of_poles.pole_errors,
    "unseen": sentences_of_models.unseen,
    "unseen pose": sentences_of_models.unseen_pose,
    "changed verdicts": versions.answer,
}


def paragraph(text: str) -> str:
    return textwrap.fill(text, LINE, break_long_words=False, break_on_hyphens=False) + "\n"


def rewritten(page: Path) -> str:
    """Returns a page with current tables and texts. Raises Error for an unknown name."""

    def block(match: re.Match[str]) -> str:
        begin, kind, name, _, end = match.groups()
        known = TEXTS if kind == "text" else {**TABLES, **FRAMES}
        if name not in known:
            raise Error(f"{page}: expected one of the {kind}s {'; '.join(known)}; got '{name}'")
        make = known[name]
        if kind == "text":
            return begin + paragraph(make()) + end
        return begin + (make() if name in FRAMES else with_frames(make)) + end

    return BLOCK.sub(block, page.read_text(encoding="utf-8"))


@command
def main(*, check: bool = False) -> int:
    """Writes the documentation's tables from results/.

    Parameters
    ----------
    check : write nothing; fail if a table or text is not current
    """
    stale = [page for page in PAGES if rewritten(page) != page.read_text(encoding="utf-8")]
    for page in stale:
        print(f"{page.relative_to(ROOT)}: {'differs from results/' if check else 'written'}")
        if not check:
            page.write_text(rewritten(page), encoding="utf-8")
    old = [name for name in figures.FIGURES if not figures.is_current(name, PICTURES)]
    for name in old:
        file = PICTURES.relative_to(ROOT) / f"{name}.svg"
        print(f"{file}: {'differs from results/' if check else 'written'}")
        if not check:
            figures.write(name, PICTURES)
    return 1 if check and (stale or old) else 0
