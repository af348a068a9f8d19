"""The style sheet: contrast, paper, small screens."""

import pytest
from playwright.sync_api import Page

from tests.browser.chromium import wait_until
from tests.browser.strips import Open, run

TEXTS = ["text", "dim", "link", "ok", "caution", "alert", "limit", "epsilon", "trace", "forecast"]
PAIRS = [(text, ground) for text in TEXTS for ground in ("page", "panel")] + [
    ("text", "raised"), ("dim", "raised"), ("on-alert", "alert-fill"),
    ("on-primary", "primary-fill"),
    ("panel", "mark-a"), ("panel", "mark-b"), ("panel", "cursor"),
]  # fmt: skip


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(first: str, second: str) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def tokens(page: Page) -> dict[str, str]:
    names = {name for pair in PAIRS for name in pair} | {"control-line", "stale", "band", "grid"}
    return page.evaluate(
        """(names) => Object.fromEntries(names.map((name) => [name,
             getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim()]))""",
        sorted(names),
    )


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_text_contrast_meets_aa(strips: Open, theme: str) -> None:
    colours = tokens(strips(f"theme={theme}"))
    weak = {
        f"{text} on {ground}": round(contrast(colours[text], colours[ground]), 2)
        for text, ground in PAIRS
        if contrast(colours[text], colours[ground]) < 4.5
    }
    assert weak == {}
    assert contrast(colours["control-line"], colours["panel"]) >= 3


def test_a_main_button_that_cannot_be_pressed_can_be_read(strips: Open) -> None:
    shown = run(
        strips("theme=light"),
        """
        const button = document.createElement('button');
        button.className = 'button button-primary';
        button.disabled = true;
        document.body.append(button);
        const { color, backgroundColor } = getComputedStyle(button);
        return [color, backgroundColor].map((rgb) =>
          '#' + rgb.match(/\\d+/g).map((n) => Number(n).toString(16).padStart(2, '0')).join(''));
        """,
    )
    assert contrast(*shown) >= 4.5


def test_paper_gets_the_light_theme_on_page_and_canvas(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    dark = tokens(page)
    page.emulate_media(media="print")
    printed = tokens(page)
    wait_until(page, "harness.pixels('p', 'panel', 2)[0] > 10000")
    page.emulate_media(media="screen")
    page.evaluate("document.documentElement.dataset.theme = 'light'")
    assert tokens(page) == printed
    assert printed["panel"] == "#ffffff" != dark["panel"]


def test_nothing_overflows_on_a_small_screen_or_a_tablet(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 30, 1000, { growth: 0.5 }); h.timeline.setMark('a', 25); h.draw(1000)")
    page.evaluate("document.querySelector('#alarm').hidden = false")
    overflow = """(({ scrollWidth, scrollHeight }) =>
        [innerWidth, innerHeight, scrollWidth, scrollHeight])(document.documentElement)"""
    width, height, scroll_width, scroll_height = page.evaluate(overflow)
    assert scroll_width <= width
    assert scroll_height <= height
    clipped = """[...document.querySelectorAll('.readout')]
        .filter((e) => e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight)
        .map((e) => e.parentElement.dataset.key)"""
    assert page.evaluate(clipped) == []
    page.set_viewport_size({"width": 820, "height": 1180})
    width, _, scroll_width, _ = page.evaluate(overflow)
    assert scroll_width <= width
    assert page.evaluate(clipped) == []


GROWN = """() => {
    const words = [];
    const write = CanvasRenderingContext2D.prototype.fillText;
    CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
        const { a, b } = this.getTransform();
        const size = this.font.match(/[\\d.]+(?=px)/)[0];
        words.push(size * Math.hypot(a, b));
        return write.call(this, text, ...at);
    };
    harness.draw(2000);
    CanvasRenderingContext2D.prototype.fillText = write;
    const wide = (name) => document.querySelector(name).getBoundingClientRect().width;
    const size = (name) => parseFloat(getComputedStyle(document.querySelector(name)).fontSize);
    const box = document.querySelector("#box") ?? document.createElement("input");
    Object.assign(box, { type: "checkbox", id: "box" });
    document.querySelector(".side-column").append(box);
    const texts = [Math.min(...words), size(".readout-value"), size(".event-list")];
    return [...texts, wide(".side-column"), wide("#box")];
}"""
"""Sizes of the texts of canvas, readouts and events, widths of the side column and a box [px]."""


def test_texts_canvases_and_panels_grow_with_the_screen(strips: Open) -> None:
    page = strips()
    grown = {}
    for width, height in ((1440, 900), (1920, 1080), (3840, 2160)):
        page.set_viewport_size({"width": width, "height": height})
        run(page, "h.feed(0, 15, 1000); h.chart.latch([]); h.draw(1000)")
        drawn = "(harness.draw(1000), document.querySelector('.strip canvas').width)"
        wait_until(page, f"{drawn} > innerWidth / 3")
        grown[width] = page.evaluate(GROWN)
    assert grown[1440][0] == pytest.approx(12)
    assert grown[1920][0] == pytest.approx(14.4)
    assert grown[3840] == pytest.approx([2 * size for size in grown[1920]], rel=0.01)
