"""The chart of a scored recording, as tests steer and read it."""

import re
from typing import Any

from playwright.sync_api import Page

COLOURS = {"alert": "#ff6a5e", "trace": "#5cc8ff", "stale": "#8d9baa", "forecast": "#e6a3ff"}


def drawn(page: Page) -> None:
    """Wait for tiles: the readouts have their numbers."""
    page.locator(".tile-value", has_text="…").first.wait_for()


def window(page: Page) -> tuple[float, float]:
    """What the strips show [s]."""
    words = page.locator(".strip-interval").inner_text()
    start, end = re.findall(r"([\d.]+)(?= to| \()", words)[:2]
    return float(start), float(end)


def pixels(page: Page, key: str, colour: str, share: tuple[float, float] = (0, 1)) -> int:
    """Pixels of a strip's plot in about a colour, from one share of its width to another."""
    return page.evaluate(
        """([key, colour, from, to]) => {
            const strip = document.querySelector(`.strip[data-key="${key}"] canvas`);
            const canvas = document.createElement("canvas");
            [canvas.width, canvas.height] = [strip.width, strip.height];
            const copy = canvas.getContext("2d", { willReadFrequently: true });
            copy.drawImage(strip, 0, 0);
            const width = canvas.width - 46;
            const [x0, x1] = [46 + from * width, 46 + to * width].map(Math.round);
            const { data } = copy.getImageData(x0, 0, x1 - x0, canvas.height);
            const wanted = [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
            let n = 0;
            for (let i = 0; i < data.length; i += 4)
              n += wanted.every((value, k) => Math.abs(data[i + k] - value) < 24);
            return n;
        }""",
        [key, COLOURS[colour], *share],
    )


def shares(scoring: dict[str, Any], k: int) -> tuple[float, float]:
    """Where a manoeuvre lies while the entire recording is shown."""
    manoeuvre, length = scoring["manoeuvres"][k], scoring["end"] - scoring["start"]
    return manoeuvre["start"] / length, manoeuvre["end"] / length


def press(page: Page, *keys: str) -> None:
    """Press keys on the strips, and let them be drawn."""
    page.locator(".strip-chart").focus()
    for key in keys:
        page.keyboard.press(key)
    redrawn(page)


def redrawn(page: Page) -> None:
    """Wait for what changed to be drawn: every second frame is."""
    page.evaluate("""() => new Promise((done) => {
        const frames = (n) => (n ? requestAnimationFrame(() => frames(n - 1)) : done());
        frames(5);
    })""")
