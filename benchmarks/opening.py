"""How long a report takes to open from disk in headless Chromium: results/opening.csv.

    .venv/bin/python benchmarks/opening.py out/report.html [MORE.html ...]

`loaded` is the page's own loadEventEnd; `drawn` is when its first 3-D view, scrolled to as soon as
the page is loaded, has drawn its frame, from before its window was opened.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests/python"))
from browser import Browser, start_browser  # noqa: E402

LOADED = "performance.getEntriesByType('navigation')[0].loadEventEnd"


def opening(browser: Browser, report: Path) -> dict[str, float]:
    """Seconds of one opening in a fresh window."""
    start = time.perf_counter()
    with browser.open(report) as opened:
        seconds = {"loaded": opened.page.evaluate(LOADED) / 1000}
        views = opened.page.locator("figure.lidar-view")
        if views.count():
            views.first.scroll_into_view_if_needed()
            opened.settle()
            seconds["drawn"] = time.perf_counter() - start
    return seconds


def row(browser: Browser, report: Path, openings: int) -> dict[str, object]:
    found = pd.DataFrame([opening(browser, report) for _ in range(openings)])
    ends = found.agg(["min", "median", "max"]).set_axis(["least", "median", "most"])
    times = {f"{name}_{word}_s": round(ends[name][word], 2) for name in ends for word in ends.index}
    megabytes = round(report.stat().st_size / 1e6, 2)
    return {"report": report.stem, "mb": megabytes, "openings": openings, **times}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("reports", nargs="+", type=Path)
    parser.add_argument("--openings", type=int, default=9)
    parser.add_argument("--out", type=Path, default=ROOT / "results/opening.csv")
    args = parser.parse_args()
    with start_browser() as browser:
        rows = [row(browser, report.resolve(), args.openings) for report in args.reports]
    about = {"command": "benchmarks/opening.py", "version": __version__, "machine": machine()}
    table = pd.DataFrame(rows).assign(**about)
    table.to_csv(args.out, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
