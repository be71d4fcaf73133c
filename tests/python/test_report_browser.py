"""The report in a real browser, opened from disk: it makes no requests, sorts tables, and fits the
screen."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import report_data
from browser import Browser, Opened

from pyinfra.cli import main
from pyinfra.formats import kitti

MOST_BYTES = 8_000_000
OPENS_IN_MS = 10_000  # ms; an idle machine takes 2,000
LIDARS = ("livox_avia", "ruby_plus")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the page of all tables, without pictures."""
    folder = tmp_path_factory.mktemp("tables")
    out = folder / "report.html"
    report_data.write(folder / "results", report_data.tables())
    assert main.main(["report", str(folder / "results"), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def pictured(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Writes the page of all tables, of a data set with two aggregations, and of predictions."""
    folder = tmp_path_factory.mktemp("pictures")
    for way in ("exact", "instant"):
        words = run_command(*LIDARS, frames="0:2", aggregation=way, out=folder / way)
        infrasim(*words, check=True)
    runs = [predictions(folder / "exact" / "livox_avia", folder, d) for d in ("pv-rcnn", "dsvt")]
    report_data.write(folder / "results", report_data.tables())
    out = folder / "report.html"
    words = ["--data", folder / "exact", folder / "instant", "--runs", *runs, "--out", out]
    words += ["--sections", "reproduction.report"]
    assert main.main(["report", str(folder / "results"), *map(str, words)]) == 0
    return out


def predictions(lidar: Path, folder: Path, detector: str) -> Path:
    """Writes a run whose predictions are the labelled boxes. The name of its folder identifies the
    experiment."""
    run = folder / f"highway_livox_avia_paper_{detector}_quick_1"
    (run / "predictions").mkdir(parents=True)
    for frame in kitti.frames(lidar):
        labels = kitti.frame_file(lidar, "label_2", frame).read_text().splitlines()
        text = "".join(f"{line} 0.9\n" for line in labels)
        (run / "predictions" / f"{frame:06d}.txt").write_text(text)
    return run


def show_view(opened: Opened) -> None:
    """Scrolls to the 3-D view, which starts when it is near the screen."""
    view = opened.page.locator(".lidar-view")
    view.scroll_into_view_if_needed()
    opened.settle()
    assert view.get_attribute("data-state") == "ready"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_asks_for_nothing_and_complains_of_nothing(
    theme: str, browser: Browser, pictured: Path
) -> None:
    with browser.open(pictured, theme=theme) as opened:
        show_view(opened)
        # data: addresses are pictures in the page
        outside = [r for r in opened.requests if not r.startswith("data:")]
        assert outside == [pictured.as_uri()]
        assert opened.problems == []


@pytest.mark.parametrize("width", [320, 768, 1600])
def test_it_fits_every_screen(width: int, browser: Browser, pictured: Path) -> None:
    with browser.open(pictured, width=width) as opened:
        opened.page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert not opened.scrolls_sideways()


@pytest.mark.parametrize("width", [390, pytest.param(1440, marks=pytest.mark.nightly)])
def test_links_of_the_contents_land_on_their_headings(
    width: int, browser: Browser, pictured: Path
) -> None:
    with browser.open(pictured, width=width) as opened:
        for link in opened.page.locator("nav a").all():
            link.evaluate("link => { scrollTo(0, 0); link.click(); }")
            opened.settle()
            opened.settle()
            target = link.get_attribute("href")
            top = opened.page.evaluate(
                f"document.querySelector('{target}').getBoundingClientRect().top"
            )
            left = "document.documentElement.scrollHeight - innerHeight - scrollY"
            assert abs(top) < 2 or opened.page.evaluate(left) < 2, target


@pytest.mark.nightly
def test_what_is_wider_than_a_phone_says_so(browser: Browser, pictured: Path) -> None:
    hint = "part => getComputedStyle(part, '::before').content.includes('Scroll sideways')"
    wide = "part => part.scrollWidth > part.clientWidth + 1"
    counts = []
    for width in (390, 1600):
        with browser.open(pictured, width=width) as opened:
            opened.page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
            opened.settle()
            parts = opened.page.locator(".scroll, figure.wide .drawing").all()
            shown = [bool(part.evaluate(hint)) for part in parts]
            assert shown == [bool(part.evaluate(wide)) for part in parts]
            counts.append(sum(shown))
    assert counts[0] > counts[1]


def test_what_scrolls_sideways_takes_the_focus_and_keeps_the_name_of_a_row_in_view(
    browser: Browser, pictured: Path
) -> None:
    left = "part => part.getBoundingClientRect().left"
    with browser.open(pictured, width=390) as opened:
        opened.page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        opened.settle()
        assert opened.page.locator(".drawing.wider").count() > 0
        for part in opened.page.locator(".wider").all():
            assert part.evaluate("part => part.tabIndex") == 0
            part.evaluate("part => { part.scrollLeft = part.scrollWidth }")
            edge = part.evaluate(left)
            for name in (
                part.locator("tbody tr:first-child").locator("th, th + td:not(.number)").all()
            ):
                assert name.evaluate(left) == pytest.approx(edge, abs=1)
                edge += name.evaluate("part => part.offsetWidth")


def test_tables_sort_both_ways_with_what_is_missing_last(browser: Browser, whole: Path) -> None:
    with browser.open(whole) as opened:
        opened.page.locator("#accuracy summary").click()
        table = opened.page.locator("#accuracy details table")
        head = table.locator("th:nth-child(6) button")
        assert head.inner_text() == "AP (R1000)"
        column = "rows => rows.map(row => row.cells[5].dataset.sort)"

        def values() -> list[str]:
            return table.locator("tbody tr").evaluate_all(column)

        assert values() == ["91.25", "92.5", "84", ""]
        head.click()
        assert values() == ["84", "91.25", "92.5", ""]
        assert table.locator("th[aria-sort=ascending]").count() == 1
        head.click()
        assert values() == ["92.5", "91.25", "84", ""]
        table.locator("th:nth-child(1) button").press("Enter")
        assert table.locator("tbody th").first.inner_text() == "Livox Avia"


def test_a_figure_is_drawn_in_the_colours_of_the_page(browser: Browser, whole: Path) -> None:
    for theme, dark in (("light", False), ("dark", True)):
        with browser.open(whole, theme=theme) as opened:
            picture = opened.pixels("#figure-latency-paper .drawing").astype(int)
            ground = np.median(picture.reshape(-1, 3), axis=0)
            assert (ground.mean() < 60) == dark
            assert np.abs(picture - ground).max(axis=2).max() > 120


def test_the_view_is_not_blank(browser: Browser, pictured: Path) -> None:
    with browser.open(pictured) as opened:
        assert opened.page.locator(".lidar-view").get_attribute("data-state") == "waiting"
        show_view(opened)
        picture = opened.pixels(".lidar-view canvas", ".lv-reset, .lv-scale, .lv-tip").astype(int)
        ground = np.median(picture.reshape(-1, 3), axis=0)
        assert np.count_nonzero(np.abs(picture - ground).max(axis=2) > 40) > 500


def test_every_figure_of_the_paper_has_its_counterpart(browser: Browser, pictured: Path) -> None:
    with browser.open(pictured) as opened:
        assert opened.page.get_by_text("not here: needs").count() == 0
        for panel in opened.page.locator("#pictures .drawing svg").all():
            assert panel.bounding_box()["height"] > 50


def test_it_prints(browser: Browser, whole: Path) -> None:
    with browser.open(whole, theme="dark") as opened:
        opened.page.emulate_media(media="print")
        colour = "getComputedStyle(document.documentElement).backgroundColor"
        assert opened.page.evaluate(colour) == "rgb(255, 255, 255)"
        assert opened.page.pdf().startswith(b"%PDF")


def test_it_is_small_and_opens_soon(browser: Browser, pictured: Path) -> None:
    assert pictured.stat().st_size < MOST_BYTES
    with browser.open(pictured) as opened:
        timing = "performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd"
        assert opened.page.evaluate(timing) < OPENS_IN_MS


def test_no_label_of_a_figure_is_cut(browser: Browser, pictured: Path) -> None:
    """Each text of a drawing lies within its drawing, to within one pixel."""
    cut = """svg => { const box = svg.getBoundingClientRect();
        return [...svg.querySelectorAll('text')].filter(text => {
            const r = text.getBoundingClientRect();
            return r.left < box.left - 1 || r.right > box.right + 1
                || r.top < box.top - 1 || r.bottom > box.bottom + 1;
        }).map(text => text.textContent); }"""
    with browser.open(pictured, width=1440) as opened:
        opened.page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        opened.settle()
        drawings = opened.page.locator(".drawing svg").all()
        assert [text for one in drawings for text in one.evaluate(cut)] == []
