"""The page of a plan in a real browser: every control moves answer, map and chart together."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest
from browser import Browser, Opened
from plan_page_data import LIDARS

from pyinfra.experiments.planner.plan import Plan
from pyinfra.viz.plan_page.page import render, write_plan_page
from pyinfra.viz.plan_page.plan_data import plan_data

HOSTILE = (
    "</script><script>document.title='taken'</script><img src=x onerror=document.title='taken'>"
)
WIDTHS = {"desk": (1440, 900), "phone": (390, 844)}
SET = "(e, value) => { e.value = value; e.dispatchEvent(new Event('input', { bubbles: true })); }"
# Elements whose text has a contrast below 4.5 with the nearest opaque ground behind it.
FAINT = """() => {
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((c) => c / 255)
    .map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const canvas = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const plain = (colour) => {
    canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const ground = (e) => {
    for (; e; e = e.parentElement) {
      const colour = plain(getComputedStyle(e).backgroundColor);
      if (colour[3] === 255) return colour;
    }
    return [255, 255, 255];
  };
  const faint = [];
  for (const e of document.querySelectorAll('body *')) {
    if (e.closest('svg, script, .hidden') || !e.checkVisibility()) continue;
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
    const [a, b] = [plain(getComputedStyle(e).color), ground(e)].map(light);
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5) faint.push([e.tagName, e.textContent.slice(0, 40), contrast]);
  }
  return faint;
}"""
UNLABELLED = """() => {
  const name = (e) => e.labels?.length || e.getAttribute('aria-label')
    || e.tagName === 'BUTTON' && e.textContent.trim()
    || (e.getAttribute('aria-labelledby') ?? '').split(' ')
      .some((id) => document.getElementById(id)?.textContent.trim());
  return [...document.querySelectorAll('input, select, button, [role=img], [role=region]')]
    .filter((e) => !name(e)).map((e) => e.outerHTML);
}"""
SHOWS = """() => {
  const [text, inner] = ['innerText', 'innerHTML'].map((key) =>
    (selector) => document.querySelector(selector)[key]);
  return {
    headline: text('.headline'), answer: text('#answer-body'), row: text('#rows tr.shown th'),
    map: inner('#map') + text('#map-text'), 'under the map': text('#map-text'),
    chart: inner('#chart'), mark: document.querySelector('#chart .mark.shown').dataset.option,
  };
}"""
REPEATED_IDS = """() => [...document.querySelectorAll('[id]')].map((e) => e.id)
  .filter((id, k, all) => all.indexOf(id) !== k)"""
LEVELS = "() => [...document.querySelectorAll('h1, h2, h3')].map((e) => Number(e.tagName[1]))"
FOCUS = "() => document.activeElement.id || document.activeElement.getAttribute('aria-label')"


@pytest.fixture(scope="module")
def file(planned: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_plan_page(planned, tmp_path_factory.mktemp("page"))


@contextmanager
def opened(
    browser: Browser, file: Path, size: str = "desk", theme: str = "light"
) -> Iterator[Opened]:
    width, height = WIDTHS[size]
    with browser.open(file, width=width, height=height, theme=theme) as view:
        yield view
        assert view.is_offline(), view.requests
        assert view.problems == []


def parts(view: Opened) -> dict[str, str]:
    """What answer, map and chart show, after a check that all show the same option."""
    shows = view.page.evaluate(SHOWS)
    number = number_in(shows["headline"])
    assert f"Option {number}:" in shows["under the map"]
    assert f"Option {number} is marked" in shows["chart"]
    assert shows["mark"] == str(number)
    assert shows["row"] == f"{number} (shown)"
    return {name: shows[name] for name in ("answer", "map", "chart")}


def shown(view: Opened) -> int:
    return number_in(view.page.locator(".headline").inner_text())


def number_in(headline: str) -> int:
    number = re.match(r"Option (\d+) finds", headline)
    assert number is not None
    return int(number[1])


def all_differ(before: dict[str, str], after: dict[str, str]) -> bool:
    return all(before[name] != after[name] for name in before)


def price(view: Opened) -> int:
    text = view.page.locator("dl.figures dd").first.inner_text().splitlines()[0]
    return int(re.sub(r"\D", "", text))


@pytest.mark.parametrize("size", WIDTHS)
def test_every_control_moves_answer_map_and_chart_together(
    browser: Browser, file: Path, size: str
) -> None:
    with opened(browser, file, size) as view:
        first = parts(view)
        assert shown(view) == 1
        assert "Met:" in first["answer"]
        page = view.page

        page.locator("#find").evaluate(SET, "99")
        dearer = parts(view)
        assert all_differ(first, dearer)
        assert "99 of 100" in page.locator("#find-text").inner_text()
        best = price(view)

        page.locator("#budget").evaluate(SET, str(best - 200))
        assert all_differ(dearer, parts(view))
        assert price(view) <= best - 200
        page.locator("#reset").click()
        assert parts(view) == first

        page.locator("#find").evaluate(SET, "99")
        page.locator("#poles-1").check()
        assert all_differ(dearer, parts(view))
        assert page.locator("#map-poles .pole").count() == 1
        page.locator("#poles-2").check()
        assert parts(view) == dearer

        page.locator("#lidar-1").uncheck()
        assert all_differ(dearer, parts(view))
        assert LIDARS[1] not in page.locator("dl.figures").inner_text()
        page.locator("#lidar-0").uncheck()
        assert "outside the budget, the poles or the LiDARs" in parts(view)["answer"]
        page.locator("#reset").click()

        page.get_by_label("Distance from the centre").select_option("30")
        assert all_differ(first, parts(view))
        assert "within 30 m" in page.locator(".headline").inner_text()
        assert page.locator(".m-within").get_attribute("r") == "30"

        page.get_by_label("What counts").select_option("stop line")
        assert "objects at stop line" in page.locator(".headline").inner_text()
        assert page.locator("#within").is_disabled()
        assert page.locator(".m-within").count() == 0
        parts(view)
        page.locator("#reset").click()
        assert parts(view) == first
        assert not view.scrolls_sideways()


def test_an_option_is_picked_in_the_table_and_in_the_chart(browser: Browser, file: Path) -> None:
    with opened(browser, file) as view:
        page, first = view.page, parts(view)
        before = page.locator("#rows tr").count()
        page.get_by_label("Show also options").check()
        assert page.locator("#rows tr").count() > before
        button = page.locator("#rows button[aria-pressed=false]").last
        number = int(button.get_attribute("data-option") or 0)
        button.press("Enter")
        assert shown(view) == number
        assert all_differ(first, parts(view))
        assert "You picked this option" in page.locator(".notes").inner_text()
        assert page.evaluate(FOCUS) == f"Show option {number}"
        page.locator('#chart [data-option="1"]').dispatch_event("click")
        assert shown(view) == 1
        page.locator("#find").evaluate(SET, "5")
        assert "You picked" not in page.locator(".notes").inner_text()


def test_the_keyboard_reaches_and_steers_every_control(browser: Browser, file: Path) -> None:
    with opened(browser, file) as view:
        names = []
        for _ in range(12):
            view.page.keyboard.press("Tab")
            names.append(view.page.evaluate(FOCUS))
        assert names[1:11] == [
            *("budget", "find", "what", "within", "poles-2", "lidar-0", "lidar-1", "reset"),
            *("view", "every"),
        ]
        first = parts(view)
        for control, key in (("find", "Home"), ("poles-2", "ArrowLeft"), ("lidar-1", "Space")):
            view.page.locator(f"#{control}").focus()
            view.page.keyboard.press(key)
            assert parts(view) != first, control
            view.page.locator("#reset").press("Enter")
            assert parts(view) == first


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_is_readable_and_labelled(browser: Browser, file: Path, theme: str) -> None:
    with opened(browser, file, theme=theme) as view:
        page = view.page
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert page.evaluate(FAINT) == []
        assert page.evaluate(UNLABELLED) == []
        assert page.evaluate(REPEATED_IDS) == []
        levels = page.evaluate(LEVELS)
        assert levels[0] == 1
        assert all(b - a <= 1 for a, b in pairwise(levels))
        assert page.locator("html").get_attribute("lang") == "en"
        assert page.title() == "LiDARs at crossroad"


def test_it_prints_on_one_white_sheet_without_controls(browser: Browser, file: Path) -> None:
    with opened(browser, file, theme="dark") as view:
        view.page.emulate_media(media="print")
        colour = "getComputedStyle(document.documentElement).backgroundColor"
        assert view.page.evaluate(colour) == "rgb(255, 255, 255)"
        assert not view.page.locator("#budget").is_visible()
        assert view.page.locator("#map").is_visible()
        sheet = view.page.locator(".sheet").inner_text()
        assert "Signature" in sheet
        assert "1. " in sheet
        assert len(re.findall(rb"/Type\s*/Page\b", view.page.pdf())) == 1


def test_hostile_names_are_shown_and_do_nothing(
    browser: Browser, planned: Plan, tmp_path: Path
) -> None:
    data = plan_data(planned)
    data["site"], data["asked"] = HOSTILE, HOSTILE
    data["lidars"] = [HOSTILE, LIDARS[1]]
    for option in data["options"]:
        for unit in option["units"]:
            unit["lidar"] = HOSTILE if unit["lidar"] == LIDARS[0] else unit["lidar"]
    data["goals"] = [one | {"what": HOSTILE} for one in data["goals"]]
    data["left_out"].append({"what": HOSTILE, "reason": HOSTILE, "count": 1})
    file = tmp_path / "hostile.html"
    file.write_text(render(data), encoding="utf-8")
    with opened(browser, file, "phone") as view:
        assert view.page.title() == f"LiDARs at {HOSTILE}"
        assert view.page.locator("img").count() == 0
        assert not view.scrolls_sideways()
