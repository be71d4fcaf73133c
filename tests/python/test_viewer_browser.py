"""The interactive view in a real browser: it draws, reacts to input, and makes no requests."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, Opened
from view_data import blob, view_frame

from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.formats.kitti import Labels
from pyinfra.viz.viewer.page import Views, fragment, library, page

STAGE = {"light": (0xF6, 0xF7, 0xF9), "dark": (0x10, 0x15, 0x1C)}
HIT, MISSED, PREDICTED = (0x00, 0x72, 0xB2), (0x7A, 0x85, 0x91), (0xD5, 0x5E, 0x00)
NAME_OF_FOCUS = """(e => e.getAttribute('aria-label') || e.labels[0]?.textContent || e.textContent)
    (document.activeElement)"""
ROAD, BUILDING = (0x55, 0x60, 0x6C), (0x8A, 0x6D, 0x3B)
INSIDE = np.s_[12:-12, 12:-12]  # the part of a picture inside the border that marks the focus
OVERLAYS = ".lv-reset, .lv-scale, .lv-tip"
HOSTILE = "</script><script>document.title='taken'</script><img src=http://192.0.2.1/a.png>\"'"

OpenView = Callable[..., AbstractContextManager[Opened]]


def boxes(*positions: tuple[float, float]) -> Any:
    return np.array([[x, y, 0.75, 4.5, 2, 1.5, 0] for x, y in positions])


def views(frames: int = 3) -> dict[str, Any]:
    """Returns views of two LiDARs. A car with points moves ahead, and another car has no points.
    The detector has found a car with scores 0.9 and 0.2. The middle of the picture shows (28, 0) on
    the ground."""

    def frame(k: int, aside: float) -> Any:
        detected = boxes((20, 8), (34, -8))
        return view_frame(
            blob(22 + 5 * k, aside, 1),
            frame=10 + k,
            boxes=boxes((22 + 5 * k, aside), (45, 12)),
            names=np.array(["Car", "Truck"]),
            hits=np.array([4000, 0]),
            time_s=np.linspace(0, 0.1, 4000, dtype=np.float32),
            object_id=np.full(4000, 7, np.int32),
            predictions=Labels(np.array(["vehicle"] * 2), detected, np.array([0.9, 0.2])),
        )

    return {
        name: [frame(k, aside) for k in range(frames)]
        for name, aside in (("First", 3.0), ("Second", -3.0))
    }


@pytest.fixture
def open_view(browser: Browser, tmp_path: Path) -> OpenView:
    @contextmanager
    def opened(shown: Views | None = None, **options: Any) -> Iterator[Opened]:
        file = tmp_path / "view.html"
        file.write_text(page(shown or views(), title="A site"), encoding="utf-8")
        with browser.open(file, **options) as view:
            view.settle()
            yield view
            assert view.is_offline(), view.requests
            assert view.problems == []

    return opened


def picture(view: Opened) -> Any:
    view.settle()
    return view.pixels(".lv-stage canvas", hidden=OVERLAYS)


def count(image: Any, colour: tuple[int, int, int], tolerance: int = 12) -> int:
    """Returns the number of pixels with nearly the given colour."""
    return int((np.abs(image.astype(int) - colour).max(axis=2) <= tolerance).sum())


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize(
    ("width", "height"), [(320, 640), pytest.param(1600, 900, marks=pytest.mark.nightly)]
)
def test_the_picture_is_drawn_at_every_width_in_both_themes(
    open_view: OpenView, width: int, height: int, theme: str
) -> None:
    with open_view(width=width, height=height, theme=theme) as view:
        image = picture(view)
        assert not view.scrolls_sideways()
        assert image.shape[1] > 0.8 * width
        background = count(image, STAGE[theme])
        assert 0.5 * image[..., 0].size < background < 0.995 * image[..., 0].size
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50


def test_points_are_where_the_camera_must_see_them(open_view: OpenView) -> None:
    """After a reset, the camera looks at the ground 28 m ahead of the sensor. The left of the
    sensor is left in the picture."""

    def column(y: float) -> float:
        # The view takes the height of the ground from vehicles, so one vehicle is far behind the
        # camera.
        more = {"boxes": boxes((-200, 0)), "names": np.array(["Car"]), "hits": np.array([0])}
        shown = {"a": [view_frame(blob(28, y, 2.5), **more)]}
        with open_view(shown, width=800, height=600) as view:
            rows, columns = np.nonzero(picture(view)[..., 0] < 120)
            assert 0.3 < rows.mean() / 500 < 0.7
            near = np.abs(columns - np.median(columns)) < 30
            return float(columns[near].mean()) / 768

    assert column(0.0) == pytest.approx(0.5, abs=0.01)
    assert column(6.0) < 0.46
    assert column(-6.0) > 0.54


def test_switching_the_lidar_and_moving_the_slider_change_the_picture(open_view: OpenView) -> None:
    with open_view() as view:
        first = picture(view)
        view.page.get_by_role("radio", name="Second").check()
        other = picture(view)
        assert (first != other).any(axis=2).mean() > 0.001
        assert "Second, frame 10: 4,000 points" in view.page.locator("figcaption").inner_text()
        view.page.get_by_role("slider", name="Frame").fill("2")
        later = picture(view)
        assert (other != later).any(axis=2).mean() > 0.001
        assert view.page.locator(".lv-time output").inner_text() == "frame 12, 1.2 s"
        view.page.get_by_role("slider", name="Frame").fill("0")
        view.page.get_by_role("radio", name="First").check()
        assert (picture(view) == first).all()


def test_boxes_have_their_colours_and_can_be_hidden(open_view: OpenView) -> None:
    with open_view() as view:
        shown = picture(view)
        for label, colour in (
            ("vehicles", HIT),
            ("without a point", MISSED),
            ("predictions", PREDICTED),
        ):
            assert count(shown, colour) > 60, label
            view.page.get_by_label(label, exact=True).uncheck()
            assert count(picture(view), colour) < 5, label


def test_predictions_below_the_score_are_hidden_and_counted(open_view: OpenView) -> None:
    with open_view() as view:
        one = count(picture(view), PREDICTED)
        assert "1 of 2 predictions" in view.page.locator("figcaption").inner_text()
        view.page.get_by_label("Least score of a prediction").fill("0.1")
        assert count(picture(view), PREDICTED) > 1.4 * one
        assert "2 of 2 predictions" in view.page.locator("figcaption").inner_text()


def test_every_colour_the_data_has_is_offered(open_view: OpenView) -> None:
    with open_view() as view:
        select = view.page.get_by_label("Colour by")
        assert select.locator("option").all_inner_texts() == [
            "Height",
            "Intensity",
            "Time in the frame",
            "Object",
        ]
        pictures = []
        for mode in ("height", "intensity", "time", "object"):
            select.select_option(mode)
            pictures.append(picture(view))
        for i in range(4):
            for j in range(i):
                assert (pictures[i] != pictures[j]).any(axis=2).mean() > 0.0005
    plain = {"a": [view_frame(blob(28, 0))]}
    with open_view(plain) as view:
        texts = view.page.get_by_label("Colour by").locator("option").all_inner_texts()
        assert texts == ["Height", "Intensity"]
        assert not view.page.locator(".lv-time, .lv-lidars").first.is_visible()


def test_the_theme_of_the_page_wins_over_that_of_the_system(open_view: OpenView) -> None:
    with open_view(theme="light") as view:
        for theme in ("dark", "light"):
            view.page.evaluate(f"document.documentElement.dataset.theme = '{theme}'")
            assert count(picture(view), STAGE[theme], 2) > 100_000
    with open_view(theme="dark") as view:
        view.page.emulate_media(color_scheme="light")
        assert count(picture(view), STAGE["light"], 2) > 100_000


def test_everything_is_reached_and_steered_with_the_keyboard(open_view: OpenView) -> None:
    with open_view() as view:
        first = picture(view)
        names = []
        for _ in range(10):
            view.page.keyboard.press("Tab")
            names.append(view.page.evaluate(NAME_OF_FOCUS).split()[0])
        assert names == [
            *("First", "3-D", "Reset", "Play", "Frame", "Colour"),
            *("vehicles", "without", "predictions", "Least"),
        ]
        view.page.locator("canvas").focus()
        before = first
        for key in ("ArrowLeft", "ArrowUp", "Shift+ArrowDown", "+", "-"):
            view.page.keyboard.press(key)
            after = picture(view)
            assert (after != before)[INSIDE].any(), key
            before = after
        view.page.keyboard.press("0")
        assert (picture(view)[INSIDE] == first[INSIDE]).all()


def test_dragging_and_the_button_reset_the_view(open_view: OpenView) -> None:
    with open_view() as view:
        first = picture(view)
        x, y = centre(view)
        view.page.mouse.move(x, y)
        view.page.mouse.down()
        view.page.mouse.move(x + 120, y + 40, steps=4)
        view.page.mouse.up()
        assert (picture(view) != first).any(axis=2).mean() > 0.001
        view.page.get_by_role("button", name="Reset view").click()
        view.page.mouse.move(1, 1)
        assert (picture(view)[INSIDE] == first[INSIDE]).all()


def test_fingers_turn_and_zoom(open_view: OpenView) -> None:
    with open_view(has_touch=True, width=320, height=640) as view:
        x, y = centre(view)
        send = view.page.context.new_cdp_session(view.page).send

        def touch(kind: str, *positions: tuple[float, float]) -> None:
            points = [{"x": at[0], "y": at[1], "id": i} for i, at in enumerate(positions)]
            send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        first = picture(view)
        touch("touchStart", (x, y))
        for step in range(1, 6):
            touch("touchMove", (x + 10 * step, y))
        touch("touchEnd")
        turned = picture(view)
        assert (turned != first).any(axis=2).mean() > 0.001
        touch("touchStart", (x - 20, y), (x + 20, y))
        for step in range(1, 6):
            touch("touchMove", (x - 20 - 10 * step, y), (x + 20 + 10 * step, y))
        touch("touchEnd")
        assert count(picture(view), HIT) > 1.3 * count(turned, HIT)


def test_a_box_under_the_pointer_is_described(open_view: OpenView) -> None:
    shown = views(frames=1)
    for (view_,), at in zip(shown.values(), ((28, 0), (28, 0)), strict=True):
        view_.boxes[0, :3] = (*at, 0)
    with open_view(shown) as view:
        x, y = centre(view)
        view.page.mouse.move(x, y)
        tip = view.page.locator(".lv-tip")
        size = " \N{MULTIPLICATION SIGN} ".join(["4.5", "2.0", "1.5"])
        assert tip.inner_text() == f"Car, {size} m, 4000 points"
        view.page.mouse.move(x, y + 150)
        assert not tip.is_visible()


def test_play_runs_through_the_frames_until_it_is_stopped(open_view: OpenView) -> None:
    with open_view() as view:
        view.page.get_by_role("button", name="Play").click()
        for text in ("frame 11, 1.1 s", "frame 12, 1.2 s", "frame 10, 1.0 s"):
            view.page.get_by_text(text, exact=True).wait_for()
        view.page.get_by_role("button", name="Stop").click()
        assert view.page.get_by_role("button", name="Play").is_visible()


def test_hostile_names_are_shown_and_do_nothing(open_view: OpenView) -> None:
    shown = {HOSTILE: views(1)["First"]}
    shown[HOSTILE][0].names[:] = HOSTILE[:5]
    with open_view(shown) as view:
        assert view.page.title() == "A site"
        assert view.page.locator("figcaption").inner_text().startswith(HOSTILE)
        assert view.page.locator("img").count() == 0


def test_two_views_stand_in_one_long_page_that_still_scrolls(
    browser: Browser, tmp_path: Path
) -> None:
    file = tmp_path / "report.html"
    parts = [fragment(views(1), element_id=name) for name in ("one", "two")]
    body = "<p style='height: 2000px'>text</p>".join(parts)
    file.write_text(f"<!DOCTYPE html><meta charset=utf-8>{body}{library()}", encoding="utf-8")
    with browser.open(file) as view:
        view.settle()
        second = view.page.locator("#two")
        assert second.get_attribute("data-state") == "waiting"
        second.scroll_into_view_if_needed()
        view.settle()
        second.get_by_role("radio", name="Second").check()
        view.settle()
        assert view.page.locator("#one figcaption").inner_text().startswith("First")
        assert second.locator("figcaption").inner_text().startswith("Second")
        view.page.evaluate("scrollTo(0, 0)")
        view.page.mouse.move(*centre(view))
        view.page.mouse.wheel(0, 300)
        view.page.wait_for_function("scrollY > 200")
        view.page.evaluate("scrollTo(0, 0)")
        view.settle()
        before = view.pixels("#one .lv-stage canvas", hidden=OVERLAYS)
        view.page.mouse.click(*centre(view))
        view.page.mouse.wheel(0, 300)
        view.settle()
        assert view.page.evaluate("scrollY") == 0
        after = view.pixels("#one .lv-stage canvas", hidden=OVERLAYS)
        assert (before != after).any(axis=2).mean() > 0.001
        assert view.is_offline()
        assert view.problems == []


def test_a_browser_without_webgl_is_told(browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "view.html"
    off = "<script>HTMLCanvasElement.prototype.getContext = () => null</script>"
    file.write_text(page(views(1), title="x").replace("<body>", f"<body>{off}"), encoding="utf-8")
    with browser.open(file) as view:
        view.page.wait_for_selector("figure[data-state=failed]")
        assert "no WebGL 2" in view.page.locator("figcaption").inner_text()


def centre(view: Opened) -> tuple[float, float]:
    box = view.page.locator("canvas").first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_road_and_buildings_are_drawn_where_they_are(tmp_path: Path, browser: Browser) -> None:
    """A road leads away below the sensor. A building is to its left."""
    (tmp_path / "roads.csv").write_text(
        "road,s,x,y,z,heading,half_width\na,0,0,0,0,0,6\na,60,60,0,0,0,6\n"
    )
    (tmp_path / "dataset.yaml").write_text(
        "roads: [{name: a, lanes: {each_way: 1, width_m: 3, median_m: 0}}]\n"
        "buildings: [{x_m: 40, y_m: 20, base_m: 0, length_m: 20, width_m: 9, height_m: 8, "
        "heading_deg: 0}]\n"
    )
    around = read_surroundings(tmp_path)
    empty = {"a": [view_frame(blob(-200, 0))]}
    file = tmp_path / "view.html"
    file.write_text(page(empty, title="A site", around=around), encoding="utf-8")
    with browser.open(file, width=800, height=600) as view:
        image = picture(view)
        assert count(image, ROAD) > 200
        rows, columns = np.nonzero(np.abs(image.astype(int) - BUILDING).max(axis=2) < 12)
        assert len(rows) > 60
        assert columns.max() < image.shape[1] / 2
        assert view.problems == []
