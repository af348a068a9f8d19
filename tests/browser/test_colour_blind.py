"""An alarm is seen before a caution by crews who see no red or no green, in both themes."""

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Locator

from core.types import Array
from tests.browser.strips import Open, run

NORMAL = np.eye(3)
PROTANOPIA = np.array([
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
])  # fmt: skip
DEUTERANOPIA = np.array([
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
])  # fmt: skip
"""Of linear RGB, at full severity: Machado, Oliveira, Fernandes (2009), IEEE TVCG 15(6)."""
EYES = {"normal": NORMAL, "protanopia": PROTANOPIA, "deuteranopia": DEUTERANOPIA}
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
MARKED = 0.02
"""Share of an element's pixels that are looked at: those with the most contrast."""

LOOKS = {
    "state": """<div class="status-item" data-item="state" data-level="{level}">
        <span class="status-name"></span><span class="status-value">{word}</span></div>""",
    "banner": """<div class="alarm-panel">
        <div class="alarm-banner" data-level="{level}">{word}</div></div>""",
    "event": """<ol class="event-list"><li class="event" data-level="{level}">
        <span class="event-text">{word}</span></li></ol>""",
}
"""As the page builds them."""
LEVELS = {"alert": ("▲ EXCEEDING", "warning"), "caution": ("◆ EXCEEDING", "caution")}


def luminance(pixels: Array, eyes: Array) -> Array:
    """Relative luminance of (..., 3) sRGB bytes as these eyes see them."""
    c = pixels / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ eyes.T, 0, 1) @ LUMINANCE


def contrast(pixels: Array, ground: Array, eyes: Array) -> Array:
    """Contrast ratio of each pixel with the ground."""
    light, dark = luminance(pixels, eyes), luminance(ground, eyes)
    return (np.maximum(light, dark) + 0.05) / (np.minimum(light, dark) + 0.05)


def picture(element: Locator) -> Array:
    """(n, 3) pixels of an element."""
    return np.asarray(Image.open(io.BytesIO(element.screenshot())).convert("RGB")).reshape(-1, 3)


def salience(pixels: Array, ground: Array, eyes: Array) -> tuple[float, float]:
    """Contrast of the most salient part, and the mean over the element."""
    ratios = np.sort(contrast(pixels, ground, eyes))
    return float(ratios[-max(1, int(MARKED * len(ratios))) :].min()), float(ratios.mean())


@pytest.fixture(params=["dark", "light"])
def theme(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.parametrize("look", LOOKS)
def test_an_alarm_has_at_least_the_contrast_of_a_caution(
    strips: Open, theme: str, look: str
) -> None:
    page = strips(f"theme={theme}")
    page.add_style_tag(url="/static/fly.css")
    seen: dict[str, Array] = {}
    for level, (word, _) in LEVELS.items():
        page.evaluate(
            """(inside) => {
              document.body.className = "flight";
              document.body.style.background = "var(--panel)";
              document.body.innerHTML = `<main id="look">${inside}</main>`;
              document.querySelector("#look").style.width = "600px";
            }""",
            LOOKS[look].format(level=level, word=word),
        )
        seen[level] = picture(page.locator("#look > *"))
    assert_leads(seen, ground_of(page.evaluate(PANEL)))


def test_the_gauge_above_its_alert_level_has_at_least_the_contrast_of_a_caution(
    strips: Open, theme: str
) -> None:
    page = strips(f"theme={theme}")
    seen: dict[str, Array] = {}
    for level, (_, given) in LEVELS.items():
        run(
            page,
            f"""
            h.dial.update({{ state: 'ok', p_value: 0.3, alert: {str(level == "alert").lower()},
                             alertAbove: 0.05 }});
            h.dial.draw(performance.now(), {{ status: 'risk', level: '{given}', beside: [] }});
            """,
        )
        seen[level] = picture(page.locator(".gauge-dial"))
    assert_leads(seen, ground_of(page.evaluate(PANEL)))


def test_the_band_of_an_alert_has_at_least_the_contrast_of_a_stale_one(
    strips: Open, theme: str
) -> None:
    page = strips(f"theme={theme}")
    kinds = {"alert": "alert", "caution": "stale"}
    seen = {level: band(page.evaluate(BAND, kind)) for level, kind in kinds.items()}
    assert_leads(seen, ground_of(page.evaluate(PANEL)))


PANEL = "getComputedStyle(document.documentElement).getPropertyValue('--panel').trim()"
BAND = """(kind) => new Promise(async (done) => {
    const { readPalette, hatch } = await import("/static/js/charts/palette.js");
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [64, 64];
    const pen = canvas.getContext("2d");
    const palette = readPalette(document.documentElement);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, 64, 64);
    pen.fillStyle = hatch(pen, kind, palette);
    pen.fillRect(0, 0, 64, 64);
    done([...pen.getImageData(8, 8, 48, 48).data]);
})"""
"""Bytes of a band as the strips hatch it."""


def band(data: list[int]) -> Array:
    return np.array(data).reshape(-1, 4)[:, :3]


def ground_of(colour: str) -> Array:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])


def assert_leads(seen: dict[str, Array], ground: Array) -> None:
    found: dict[str, Any] = {
        name: {level: salience(pixels, ground, eyes) for level, pixels in seen.items()}
        for name, eyes in EYES.items()
    }
    for each in found.values():
        for alarm, caution in zip(each["alert"], each["caution"], strict=True):
            assert alarm >= caution, found
