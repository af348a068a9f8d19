"""The strips by themselves, fed by hand and drawn at a given clock through `window.harness`."""

from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

GUTTER = 46
Open = Callable[..., Page]


def run(page: Page, script: str) -> Any:
    """Run statements with `h` as the harness; the last one may `return`."""
    return page.evaluate(f"(() => {{ const h = window.harness; {script} }})()")


def readout(page: Page, key: str, part: str = "value") -> str:
    return page.locator(f'.strip[data-key="{key}"] .readout-{part}').inner_text()


def plot_width(page: Page) -> float:
    return (
        page.evaluate("document.querySelector('.strip canvas').width / devicePixelRatio") - GUTTER
    )
