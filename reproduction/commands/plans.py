"""Answers realistic questions with `pyinfra plan` and records the time of each answer.

Each question names a site, a budget and a wanted share. The command writes a row for each option
that the plan simulated in full. It also records the number of poses and LiDARs, the processor time
of their race (`race_cpu_s`) and of the whole plan (`cpu_s`). Questions that are in the output are
kept. Run the command again to resume.

    python -m reproduction plans --work out/plans --out results/plans.csv
"""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.plan import Plan, plan
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.detectability.runs import scene_file_of

T_JUNCTION, TOWN_JUNCTION = 900015, 900048  # seeds of the scene generator
CHECK_FRAMES = 30
FIGURES = (
    "recall recall_low recall_high recall_simulated people_recall people_recall_simulated "
    "ap_predicted ap_predicted_low ap_predicted_high ap_simulated ap_simulated_low "
    "ap_simulated_high false_per_frame_simulated position_m_simulated latency_ms price_usd "
    "price_usd_low price_usd_high gap"
).split()
KEY = ["question", "option"]
TEXT = [
    "question",
    "site",
    "only",
    "lidars",
    "heights_m",
    "places_m",
]  # columns of text


@dataclass(frozen=True)
class Question:
    """A site, a budget and the requirements for which `pyinfra plan` makes a plan."""

    question: str
    site: str | int  # name of a scene, or a seed of the scene generator
    budget_usd: float
    find_percent: float
    within_m: float
    poles: int = 1
    people: float = 0.0
    only: str = ""  # name of the only LiDAR that is considered; empty for all


QUESTIONS = (
    Question("crossroad, 80 m", "crossroad", 8000, 90, 80),
    Question("curve, 60 m", "curve", 12000, 95, 60),
    Question("one pole", "crossroad", 16000, 95, 60),
    Question("two poles", "crossroad", 16000, 95, 60, poles=2),
    Question("two poles with 16 lines", "crossroad", 16000, 95, 60, poles=2, only="helios_16"),
    Question("T-junction", T_JUNCTION, 9000, 90, 60, people=1),
    Question("junction of a town", TOWN_JUNCTION, 9000, 90, 60, people=1),
)


def answered(question: Question, work: Path) -> tuple[Plan, dict[str, float]]:
    """Returns the plan of a question, and the processor times of its race and of the whole plan."""
    site = question.site
    scene = scene_file_of(site, work) if isinstance(site, int) else site
    started = time.process_time()
    times = {"race_cpu_s": 0.0, "cpu_s": 0.0}

    def progress(line: str) -> None:
        if line.endswith("frames"):  # the line reports a finished stage of the search
            times["race_cpu_s"] = time.process_time() - started

    result = plan(
        scene,
        question.budget_usd,
        find=question.find_percent / 100,
        within_m=question.within_m,
        poles=question.poles,
        people=question.people,
        lidars=[question.only] if question.only else (),
        check_frames=CHECK_FRAMES,
        progress=progress,
    )
    return result, times | {"cpu_s": time.process_time() - started}


def rows_of(
    question: Question, result: Plan, times: dict[str, float]
) -> Iterator[dict[str, object]]:
    """Yields a row for each option that was simulated in full."""
    candidates = result.candidates.dropna(subset="lidar")
    for number, units in result.options.groupby("option"):
        first = units.iloc[0]
        if pd.isna(first.ap_simulated):
            continue
        yield {
            **asdict(question),
            "site": str(question.site),
            "option": number,
            "lidars": " + ".join(units.lidar),
            "heights_m": " + ".join(f"{h:.1f}" for h in units.height_m),
            "places_m": " + ".join(
                f"({x:.1f}, {y:.1f})" for x, y in units[["x_m", "y_m"]].to_numpy()
            ),
            **first[list(FIGURES)].to_dict(),
            "poses": len(candidates[POSE].drop_duplicates()),
            "pairs": len(candidates),
            **times,
        }


@command
def main(*, work: Work, out: Out = Path("plans.csv")) -> None:
    """
    Parameters
    ----------
    work : folder for sites
    """
    for question in QUESTIONS:
        known = store.read(out, TEXT)
        if not known.empty and (known.question == question.question).any():
            continue
        result, times = answered(question, work)
        table = pd.DataFrame(rows_of(question, result, times)).assign(**provenance("plans"))
        store.put(out, table, KEY)
        print(f"{question.question}: {times['cpu_s']:.0f} CPU s\n{result.text}\n", flush=True)
