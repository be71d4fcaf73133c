"""Pages from disk in a real headless Chromium, for the tests of what is written as HTML."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

CHROMIUM = "/usr/bin/chromium"  # scripts/apt-packages.txt
# WebGL in software, and no calls of the browser's own.
SWITCHES = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
PATIENCE_MS = 120_000
TWO_TURNS = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
# A promise and not wait_for_function(): its later looks are evaluated under the page's own policy.
ALL_DRAWN = """(async () => {
    const views = [...document.querySelectorAll('figure.lidar-view')];
    while (views.some(view => view.dataset.state === 'drawing'))
        await new Promise(requestAnimationFrame);
})()"""


@dataclass(frozen=True)
class Opened:
    """A page that is open, and what it did."""

    page: Any  # playwright's
    requests: list[str] = field(default_factory=list)  # addresses, that of the page itself first
    problems: list[str] = field(default_factory=list)  # errors and warnings of the console

    def is_offline(self) -> bool:
        """Nothing but the page itself was asked for."""
        return len(self.requests) == 1 and self.requests[0].startswith("file://")

    def scrolls_sideways(self) -> bool:
        wide = "document.documentElement.scrollWidth > document.documentElement.clientWidth"
        return bool(self.page.evaluate(wide))

    def settle(self) -> None:
        """Waits until what the views near the screen were asked for is unpacked and drawn."""
        self.page.evaluate(TWO_TURNS)
        self.page.evaluate(ALL_DRAWN)
        self.page.evaluate(TWO_TURNS)

    def pixels(self, selector: str, hidden: str = "[hidden]") -> npt.NDArray[np.uint8]:
        """An element as on the screen, (h, w, 3), without what the selector `hidden` names."""
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
        """A page from disk in a fresh window without a network; `more` goes to new_context()."""
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
