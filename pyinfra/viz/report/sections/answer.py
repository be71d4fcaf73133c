"""The first section: the best LiDAR and detector for each purpose."""

from collections.abc import Callable

import pandas as pd

from pyinfra.dataset.catalogue import SCENES
from pyinfra.experiments.benchmark.replicates import ExperimentReplicates
from pyinfra.experiments.fairness import caveat_of_results
from pyinfra.experiments.requirements import frame_ms
from pyinfra.experiments.result_tables import AS_THEY_COME
from pyinfra.metrics.row_selection import AP_OF, AP_R1000, COUNTED
from pyinfra.viz.report.blocks import Block, Card, CardLine, Cards, Section, Text, span
from pyinfra.viz.report.names import with_detector
from pyinfra.viz.report.report_data import ANY_PRICE, Material
from pyinfra.viz.report.sections import accuracy, recommendation

TITLE = "Recommended LiDAR and detector by purpose"
NOT_SIGNIFICANT = (
    "These results have no bootstrap replicates, so it is not known whether the best option "
    "differs significantly from the next. Run pyinfra benchmark again to compute them."
)
CLOSE_AP = 5.0  # maximum difference in AP between a faster or cheaper choice and the best AP

Choice = Callable[[Material, pd.DataFrame], CardLine | None]


def section(material: Material) -> Section | None:
    """Returns recommendations for the user's sites, and the best choices for this package's scenes.

    If the user gives requirements, such as a budget, this package's scenes get recommendations too.
    """
    done = material.results.done()
    if done.empty:
        return None
    asked = material.requirements != ANY_PRICE  # a user's requirements apply to all scenes
    scenes = [scene for scene in material.scenes() if scene in set(done.scene)]
    can_answer = recommendation.can_answer(material)
    of_user = [s for s in scenes if can_answer and (asked or s not in SCENES)]
    answers = recommendation.answers(material, of_user)
    alone = len(scenes) == 1
    sentences = [recommendation.sentence(material, one, alone=alone) for one in answers]
    blocks = [b for one in answers for b in recommendation.blocks(material, one, alone=alone)]
    others = done[~done.scene.isin(of_user)]
    if len(others) > 0:
        rows = material.of_answers(others)
        sentences += [
            _sentence(material, rows[rows.scene == s]) for s in scenes if s not in of_user
        ]
        blocks += _of_purposes(material, others)
    caveat = material.names.spelled(caveat_of_results(zip(done.lidar, done.detector, strict=True)))
    if alone:
        return Section("answer", TITLE, f"{sentences[0]} {caveat}".rstrip(), blocks)
    if len(others) > 0:
        lead = _overall(material, material.of_answers(done))
    else:
        lead = recommendation.overall(material, answers)
    return Section("answer", TITLE, f"{lead} {caveat}".rstrip(), [*map(Text, sentences), *blocks])


def _of_purposes(material: Material, done: pd.DataFrame) -> list[Block]:
    """Returns the best choice for each purpose, under one preset per scene."""
    experiments = material.of_answers(done)
    cards = [_card(material, experiments, *purpose) for purpose in PURPOSES]
    blocks: list[Block] = [
        Cards([card for card in cards if card.lines], material.results.source("experiments"))
    ]
    chosen = experiments.drop_duplicates(["scene", "preset"])
    named = ", ".join(f"{row.scene} {row.preset}" for row in chosen.itertuples())
    if len(done) > len(experiments):
        text = (
            f"Presets in this section: {named}. The choice can differ with the other presets of "
            f'section "{accuracy.TITLE}".'
        )
        blocks.append(Text(text))
    if material.results.table("replicates").empty:
        blocks.append(Text(NOT_SIGNIFICANT))
    return blocks


def _overall(material: Material, experiments: pd.DataFrame) -> str:
    """Returns a text on the LiDAR and detector with the highest mean AP over all scenes."""
    scenes = experiments.scene.nunique()
    rows = pd.concat([_to_compare(rows)[0] for _, rows in experiments.groupby("scene")])
    table = rows.pivot_table(index=["lidar", "detector"], columns="scene", values="compared")
    everywhere = table.dropna() if table.shape[1] == scenes else table[:0]
    if everywhere.empty:
        return f"No LiDAR and detector have an AP in all {scenes} scenes."
    at = int(everywhere.mean(axis=1).argmax())
    best, (lidar, name) = everywhere.iloc[at], everywhere.index[at]
    less = table.max() - best
    behind = (
        f"is up to {less.max():.1f} below the best of a scene ({less.idxmax()})"
        if less.max() > 0
        else "is the highest of each scene"
    )
    return (
        f"Over all {scenes} scenes, {material.names.model(lidar)} {with_detector(name)} has the "
        f"highest mean {AP_R1000} of the vehicles of the whole road: {best.mean():.1f}. Its "
        f"AP is lowest at {best.idxmin()} ({best.min():.1f}), and {behind}."
    )


def _sentence(material: Material, rows: pd.DataFrame) -> str:
    """Returns the answer for a scene in words."""
    best = rows.loc[rows.ap_r1000.idxmax()]
    where = f"On the {best.scene}, preset {best.preset}"
    if _one_detector(material):
        where += f", {with_detector(best.detector)}"
    of_captured = (
        f"{_name(material, best)} has the highest AP of the vehicles that a LiDAR captures: "
        f"{AP_R1000} {best.ap_r1000:.1f} {span(best.ap_r1000_low, best.ap_r1000_high)}"
        f"{_rest(material, rows, best, 'captured')}."
    )
    if rows.ap_whole_r1000.isna().all():
        return f"{where}, {of_captured}"
    whole = rows.loc[rows.ap_whole_r1000.idxmax()]
    text = (
        f"{where}, {_name(material, whole)} has the highest AP of {COUNTED[whole.whole]} on the "
        f"road: {AP_R1000} {whole.ap_whole_r1000:.1f}"
        f"{_rest(material, rows, whole, whole.whole)}. "
    )
    cheap = _cheapest(material, rows)
    if cheap is not None and cheap.choice != _name(material, whole):
        text += f"{cheap.choice} is the cheapest LiDAR within {CLOSE_AP:g} AP: {cheap.reason}. "
    return text + of_captured


def _card(material: Material, experiments: pd.DataFrame, question: str, choose: Choice) -> Card:
    scenes = [s for s in material.scenes() if s in set(experiments.scene)]
    lines = [choose(material, experiments[experiments.scene == scene]) for scene in scenes]
    return Card(question, [line for line in lines if line is not None])


def _in_view(material: Material, rows: pd.DataFrame) -> CardLine | None:
    best = rows.loc[rows.ap_r1000.idxmax()]
    rest = _rest(material, rows, best, "captured")
    reason = f"{AP_R1000} {best.ap_r1000:.1f} {span(best.ap_r1000_low, best.ap_r1000_high)}{rest}"
    return _line(material, best, reason)


def _whole_road(material: Material, rows: pd.DataFrame) -> CardLine | None:
    if rows.ap_whole_r1000.isna().all():
        return None
    best = rows.loc[rows.ap_whole_r1000.idxmax()]
    others = rows[rows.lidar != best.lidar]
    reason = f"{AP_R1000} {best.ap_whole_r1000:.1f} on {COUNTED[best.whole]}"
    if others.ap_whole_r1000.notna().any():
        second = others.loc[others.ap_whole_r1000.idxmax()]
        reason += f"; next {material.names.model(second.lidar)}, {second.ap_whole_r1000:.1f}"
    return _line(material, best, f"{reason}{_rest(material, rows, best, best.whole)}")


def _fastest(material: Material, rows: pd.DataFrame) -> CardLine | None:
    rows, of = _to_compare(rows)
    near = rows[(rows.compared >= rows.compared.max() - CLOSE_AP) & rows.latency_p50_ms.notna()]
    if near.empty:
        return None
    best = near.loc[near.latency_p50_ms.idxmin()]
    limit_ms = frame_ms(material.results.table("lidars"), best.lidar, best.preset)
    late = f", more than the {limit_ms:g} ms of a frame" if best.latency_p50_ms > limit_ms else ""
    return _line(
        material,
        best,
        f"{best.latency_p50_ms:.0f} ms a frame{late}, {AP_R1000} {best.compared:.1f} {of}",
    )


def _cheapest(material: Material, rows: pd.DataFrame) -> CardLine | None:
    rows, of = _to_compare(rows)
    prices = material.results.table("lidars").drop_duplicates("lidar").set_index("lidar")
    price = rows.lidar.map((prices.price_low_usd + prices.price_high_usd) / 2)
    near = rows[(rows.compared >= rows.compared.max() - CLOSE_AP) & price.notna()]
    if near.empty:
        return None
    cheap = near[price[near.index] == price[near.index].min()]
    best = cheap.loc[cheap.compared.idxmax()]
    reason = f"US$ {price[best.name]:,.0f}, {AP_R1000} {best.compared:.1f} {of}"
    return _line(material, best, reason)


def _untrained(material: Material, rows: pd.DataFrame) -> CardLine | None:
    rows, of = _to_compare(rows)
    untrained = rows[rows.detector.isin(AS_THEY_COME) & rows.compared.notna()]
    if untrained.empty or len(untrained) == len(rows):
        return None
    best = untrained.loc[untrained.compared.idxmax()]
    speed = f", {best.latency_p50_ms:.0f} ms a frame" if best.latency_p50_ms > 0 else ""
    return _line(
        material,
        best,
        f"{AP_R1000} {best.compared:.1f} {span(best.compared_low, best.compared_high)} {of}{speed}",
    )


def _to_compare(rows: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Returns the rows with the AP by which they are compared, and a text on the AP's vehicles.

    The AP is in the columns compared, compared_low and compared_high. If a scene has no AP of the
    whole road, the AP of the vehicles that each LiDAR captured is used.
    """
    known = bool(rows.ap_whole_r1000.notna().any())
    name = "ap_whole" if known else "ap"
    of = COUNTED[rows.whole.iloc[0]] if known else "the vehicles it captures"
    ends = {f"compared{end}": rows[f"{name}_r1000{end}"] for end in ("", "_low", "_high")}
    return rows.assign(**ends), f"of {of}"


PURPOSES: tuple[tuple[str, Choice], ...] = (
    ("Highest AP of the vehicles it captures", _in_view),
    ("Highest AP of the whole road", _whole_road),
    (f"Fastest with at most {CLOSE_AP:g} AP less than the best", _fastest),
    (f"Cheapest LiDAR with at most {CLOSE_AP:g} AP less than the best", _cheapest),
    ("Without labels of the site", _untrained),
)


def _line(material: Material, row: pd.Series, reason: str) -> CardLine:
    return CardLine(str(row.scene), _name(material, row), reason, str(row.origin))


def _rest(material: Material, rows: pd.DataFrame, best: pd.Series, truth: str) -> str:
    """Returns a text with the rows whose AP (R1000) does not differ significantly from the best."""
    others = rows[rows.index != best.name].sort_values(f"{AP_OF[truth]}_r1000", ascending=False)
    replicates = ExperimentReplicates(material.results.table("replicates"))
    if others.empty:
        return ""
    if replicates.row(best, truth) is None:
        return ""
    alike = replicates.alike(best, (row for _, row in others.iterrows()), truth)
    if not alike:
        return ""
    return f"; the difference to {_listed(material, others.iloc[alike])} is not significant"


def _one_detector(material: Material) -> bool:
    return bool(material.results.table("experiments").detector.nunique() == 1)


def _name(material: Material, row: pd.Series) -> str:
    """Returns the name of the LiDAR, with the detector if there are several detectors."""
    if _one_detector(material):
        return material.names.model(row.lidar)
    return f"{material.names.model(row.lidar)} {with_detector(row.detector)}"


def _listed(material: Material, rows: pd.DataFrame, most: int = 2) -> str:
    """Returns the names of the first `most` rows and the number of the other rows, as text."""
    names = [_name(material, row) for _, row in rows.head(most).iterrows()]
    if len(rows) > most:
        return f"{', '.join(names)} and {len(rows) - most} more"
    return " and ".join(names)
