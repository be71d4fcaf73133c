"""Simulates traffic with SUMO for a site folder."""

from __future__ import annotations

from pathlib import Path

from pyinfra.scenes.maps import site_folder
from pyinfra.scenes.maps.site_folder import NET
from pyinfra.scenes.maps.tracks import lasts_s
from pyinfra.scenes.maps.traffic import simulate
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.scenes.maps.traffic_figures import report_lines
from pyinfra.scenes.maps.trajectory_file import NAME, write_trajectories


def write_traffic(site: Path, demand: Demand, seconds: float, seed: int) -> list[str]:
    """Writes trajectories.csv of a site, sets its duration, and returns the lines of a report.

    Raises Error for a demand out of range, MissingPackage if SUMO is not installed, and OSError.
    """
    feet = site_folder.feet(site)
    traffic = simulate(site / NET, feet, demand, seconds, seed)
    write_trajectories(site / NAME, traffic.tracks)
    site_folder.set_duration(site, lasts_s(traffic.tracks))
    notes = [f"{name}: left out: smoothing failed" for name in traffic.rough]
    if traffic.unrouted:
        text = f"{len(traffic.unrouted)} of {traffic.asked} trips left out: no valid route"
        notes.insert(0, text)
    notes += [f"{name}: left out: it overlaps another object" for name in traffic.overlapping]
    return list(report_lines(site / NAME, traffic.tracks, feet, notes))
