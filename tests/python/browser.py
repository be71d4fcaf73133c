"""Opens pages from disk in a headless Chromium, for the tests of written HTML pages."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

CHROMIUM = "/usr/bin/chromium"  # from the package in scripts/apt-packages.txt
# Chromium renders WebGL in software, and makes no network requests of its own.
SWITCHES = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
PATIENCE_MS = 120_000
TWO_TURNS = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
# A promise is used instead of wait_for_function(), because the later calls of that function are
# subject to the content policy of the page.
ALL_DRAWN = """(async () => {
    const views = [...document.querySelectorAll('figure.lidar-view')];
    while (views.some(view => view.dataset.state === 'drawing'))
        await new Promise(requestAnimationFrame);
})()"""


@dataclass(frozen=True)
class Opened:
    """An open page, its requests and its console messages."""

    page: Any  # the page object of Playwright
    # requested addresses; the first one is that of the page
    requests: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)  # errors and warnings in the console

    def is_offline(self) -> bool:
        """Returns whether the page requested nothing but itself."""
        return len(self.requests) == 1 and self.requests[0].startswith("file://")

    def scrolls_sideways(self) -> bool:
        wide = "document.documentElement.scrollWidth > document.documentElement.clientWidth"
        return bool(self.page.evaluate(wide))

    def settle(self) -> None:
        """Waits until all requested frames of the views near the screen are unpacked and drawn."""
        self.page.evaluate(TWO_TURNS)
        self.page.evaluate(ALL_DRAWN)
        self.page.evaluate(TWO_TURNS)

    def pixels(self, selector: str, hidden: str = "[hidden]") -> npt.NDArray[np.uint8]:
        """Returns the pixels of an element: (h, w, 3). Elements that match the selector `hidden`
        are left out."""
        style = f"{hidden} {{ visibility: hidden !important; }}"
        png = self.page.locator(selector).first.screenshot(style=style)
        with Image.open(io.BytesIO(png)) as image:
            return np.asarray(image.convert("RGB"))


class Browser:
    """A running Chromium."""

    def __init__(self, chromium: Any) -> None:
        self.chromium = chromium

    @contextmanager
    def open(
        self, file: Path, *, width: int = 1024, height: int = 700, theme: str = "light", **more: Any
    ) -> Iterator[Opened]:
        """Opens a page from disk in a new window without a network. `more` is passed to
        new_context()."""
        size = {"width": width, "height": height}
        context = self.chromium.new_context(
            viewport=size, color_scheme=theme, **{"offline": True} | more
        )
        context.set_default_timeout(PATIENCE_MS)
        opened = Opened(context.new_page())
        opened.page.on("request", lambda request: opened.requests.append(request.url))
        opened.page.on("pageerror", lambda error: opened.problems.append(str(error)))
        opened.page.on("console", lambda message: _note(opened, message))
        opened.page.goto(file.as_uri())
        try:
            yield opened
        finally:
            context.close()


@contextmanager
def start_browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=CHROMIUM, args=SWITCHES, timeout=PATIENCE_MS
        )
        yield Browser(chromium)
        chromium.close()


def _note(opened: Opened, message: Any) -> None:
    if message.type in ("error", "warning"):
        opened.problems.append(message.text)
