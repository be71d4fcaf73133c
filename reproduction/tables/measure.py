"""Makes tables about the reliability of intervals."""

from reproduction.tables.common import LIDARS, markdown, results, rows_with
from reproduction.tables.sentences import span


def intervals() -> str:
    held = results("coverage").held_percent
    return (
        f"Nominal 95 % intervals contain the true AP in {span(held)} % of simulated tests, if time "
        "blocks are as long as the stay of a vehicle."
    )


def coverage() -> str:
    """Returns a table by scene and test span of the coverage and width of intervals of AP."""
    table = results("coverage")
    rows = []
    for (scene, span_s), group in table.groupby(["scene", "span_s"], sort=False):
        cells = [f"{r.held_percent:.0f} ({r.width:.1f})" for r in group.itertuples()]
        rows.append([scene, f"{span_s}", f"{group.block_s.iloc[0]:.0f}", *cells])
    figures = list(dict.fromkeys(table.figure.str.replace(" less ", " minus ")))
    return markdown(["scene", "test, s", "block, s", *figures], rows)


def correlation() -> str:
    """Returns a table of block lengths and of correlation times of Background's errors."""
    table = rows_with(results("correlation"), ground_truth="all")
    by_lidar = table.pivot(index="scene", columns="lidar", values="correlation_s")
    rows = [
        [scene, f"{group.block_s.iloc[0]:.0f}", *(f"{by_lidar.loc[scene, x]:.0f}" for x in LIDARS)]
        for scene, group in table.groupby("scene", sort=False)
    ]
    return markdown(["scene", "block, s", *LIDARS.values()], rows)
