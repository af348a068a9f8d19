"""The band of simulated safe flights, and the interval of the forecast."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.chromium import wait_until
from tests.browser.strips import GUTTER, Open, plot_width, readout, run

FACTS = """window.simulated = {
    flights: async () => ({ reason: "", safe: [], unsafe: [] }),
    facts: async () => ({
        reason: "", quantiles: [0.05, 0.95], lead_in: 1, band_reason: "", forecast_reason: "",
        band: { t: [0, 4], n_flights: 123, onset: 1,
                channels: { Ny: { low: [0.1, 0.1], high: [0.45, 0.45] },
                            beta: { low: [-5, -5], high: [5, 5] } } },
        forecast: { n_flights: 123, covered: 0.7, channels: { Ny: { low: -0.01, high: 0.02 } } },
    }),
};"""


@pytest.fixture
def drawn(strips: Open, own_page: Page) -> Page:
    own_page.add_init_script(FACTS)
    own_page.goto(strips().url)
    wait_until(own_page, "window.harness")
    run(own_page, "h.feed(0, 14, 1000); h.draw(1000)")
    wait_until(own_page, "!document.querySelector('.view-items input').disabled")
    run(own_page, "h.draw(1100)")
    return own_page


SPAN = """
    const { canvas } = document.querySelector('.strip[data-key="KEY"] canvas').getContext('2d');
    const { width, height } = canvas;
    const pen = Object.assign(document.createElement('canvas'), { width, height })
        .getContext('2d', { willReadFrequently: true });
    const drawn = () => {
        pen.drawImage(canvas, 0, 0);
        return new Uint32Array(pen.getImageData(0, 0, width, height).data.buffer);
    };
    const first = drawn();
    document.querySelector('.view-items input').click();
    h.draw(1100);
    const second = drawn();
    let [low, high] = [Infinity, -Infinity];
    for (let i = 0; i < first.length; i += 1) {
        const [x, y] = [i % width, Math.floor(i / width)];
        if (x < GUTTER || first[i] === second[i]) continue;
        [low, high] = [Math.min(low, AT), Math.max(high, AT)];
    }
    return [low, high, height];
"""


def changed(page: Page, key: str, at: str) -> list[float]:
    """First and last column `x` or row `y` that differ without the band; height [px]."""
    text = SPAN.replace("GUTTER", str(GUTTER)).replace("KEY", key).replace("AT", at)
    return run(page, text)


def columns(page: Page) -> list[float]:
    """First and last column of the strip's plot that differ without the band, as times [s]."""
    start, end = run(page, "const { start, end } = h.timeline.view(1100); return [start, end];")
    step = (end - start) / plot_width(page)
    return [start + (column - GUTTER) * step for column in changed(page, "Ny", "x")[:2]]


def test_the_band_begins_at_the_manoeuvres_start_and_can_be_hidden(drawn: Page) -> None:
    assert columns(drawn) == pytest.approx([9, 13], abs=0.1)  # a trim segment of 1 s after 8 s
    expect(drawn).to_have_url(re.compile("band=off"))


def test_the_scale_holds_the_whole_band_however_small_the_values(drawn: Page) -> None:
    top, bottom, height = changed(drawn, "beta", "y")
    assert 0 < top < 0.3 * height
    assert 0.7 * height < bottom < height - 1


def test_the_band_never_hides_the_trace_or_the_limit(drawn: Page) -> None:
    count = "return ['trace', 'limit'].map((token) => h.pixels('Ny', token)[0])"
    with_band = run(drawn, count)
    drawn.evaluate("document.querySelector('.view-items input').click(), harness.draw(1100)")
    assert with_band == pytest.approx(run(drawn, count), rel=0.1)


def test_the_forecast_is_shown_with_its_interval(drawn: Page) -> None:
    value = run(drawn, "return h.frame(13.98).y_hat[3]")
    text = readout(drawn, "Ny", "detail").replace("−", "-")
    assert text == f"in 0.50 s {value - 0.01:.3f} … {value + 0.02:.3f}"
    assert "70 % of failing ones" in (drawn.locator(".view-items .hint").text_content() or "")
