"""A small plan with an area and a simulated option, for the tests of its page."""

from dataclasses import replace
from pathlib import Path

import pyinfra as pi
from pyinfra.experiments.planner.plan import Plan

FEW = pi.PoseGrid(every_m=40, heights_m=(5.0,), pitches_deg=(0.0,), yaws=1)
LIDARS = ("helios_16", "pandar_64")
BUDGET_USD = 40_000
SIMULATED = {"recall": 91.0, "ap": 85.0, "false_per_frame": 1.5}


def small_plan(folder: Path) -> Plan:
    """Two LiDARs on up to two poles; option 1 has simulated figures."""
    areas = folder / "areas.csv"
    areas.write_text("name,x_m,y_m,radius_m,class\nstop line,-30,-3,25,vehicle\n")
    plan = pi.plan(
        "crossroad",
        BUDGET_USD,
        find=0.7,
        poles=2,
        lidars=LIDARS,
        grid=FEW,
        areas=areas,
        preset="paper",
        frames=6,
        check_frames=0,
        out=folder,
    )
    tables = []
    for table in (plan.options, plan.front.table):
        some = table.copy()
        first = some.option == 1
        for name, value in SIMULATED.items():
            for end, more in (("", 0), ("_low", -1), ("_high", 1)):
                some.loc[first, f"{name}_simulated{end}"] = value + more
        some.loc[first, "position_m_simulated"] = 0.4
        some.loc[first, "source"] = "simulated"
        tables.append(some)
    return replace(plan, options=tables[0], front=replace(plan.front, table=tables[1]))
