"""Cost of drawing and of an hour of samples, in Chromium without a graphics card.

The peer is uPlot, the fastest open time-series chart, drawing the same 7 x 3,000 points: set
UPLOT to the `dist` folder of the npm package (`npm install uplot` in any folder).
"""

import os
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from tests.browser.chromium import file_server, open_chromium, wait_until

pytestmark = pytest.mark.benchmark

FRAMES = 300

# Times `draw()` on each animation frame; reading a pixel makes Chromium paint what was recorded.
# uPlot draws in a microtask, so one is waited for.
MEASURE = """
async ([frames, paint]) => {
  const { draw, canvases } = window.bench;
  const pens = canvases().map((canvas) => canvas.getContext('2d'));
  const times = [];
  for (let k = 0; k < frames; k++) {
    await new Promise(requestAnimationFrame);
    const begin = performance.now();
    draw(k);
    await null;
    if (paint) for (const pen of pens) pen.getImageData(0, 0, 1, 1);
    times.push(performance.now() - begin);
  }
  times.sort((a, b) => a - b);
  return [times[times.length >> 1], times[Math.floor(times.length * 0.95)]];
}
"""

OURS = """
() => {
  const h = window.harness;
  h.feed(0, 60, 0, { growth: 0.1 });
  let t = 60;
  window.bench = {
    draw: () => {
      h.feed(t, t + 1 / 30, 1000 * t, { growth: 0.1 });
      t += 1 / 30;
      h.draw(1000 * t);
    },
    canvases: () => [...document.querySelectorAll('#strips canvas')],
  };
}
"""

PEER = """
([source, css]) => {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(css);
  document.adoptedStyleSheets = [sheet];
  const h = window.harness;
  const strips = document.querySelector('#strips');
  const { width } = strips.querySelector('canvas').getBoundingClientRect();
  strips.replaceChildren();
  const columns = (begin) => {
    const t = Array.from({ length: 3000 }, (_, k) => begin + k / 50);
    const frames = t.map((time) => h.frame(time, { growth: 0.1 }));
    return [0, 1, 2, 3, 4, 5, 6].map((c) => [t, frames.map((f) => (c < 6 ? f.y[c] : f.p_value))]);
  };
  const steps = Array.from({ length: 8 }, (_, k) => columns(k));
  const axes = [{ show: false }, { stroke: '#aebccb', grid: { stroke: '#22303d' } }];
  const charts = steps[0].map((data) => new window.uPlot({
    width, height: 76, legend: { show: false }, cursor: { show: false }, axes,
    series: [{}, { stroke: '#5cc8ff', width: 1.8, points: { show: false } }],
    scales: { x: { time: false } },
  }, data, strips));
  window.bench = {
    draw: (k) => charts.forEach((chart, c) => chart.setData(steps[k % 8][c])),
    canvases: () => charts.map((chart) => chart.ctx.canvas),
  };
}
"""


def harness(browser: Browser, origin: str, query: str = "") -> Page:
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.goto(f"{origin}/browser/strip_harness.html?{query}")
    wait_until(page, "window.harness")
    return page


def measured(page: Page) -> str:
    script, painted = (page.evaluate(MEASURE, [FRAMES, paint]) for paint in (False, True))
    return (
        f"draw loop median {script[0]:.2f} ms, p95 {script[1]:.2f} ms; "
        f"with painting forced median {painted[0]:.2f} ms, p95 {painted[1]:.2f} ms"
    )


def test_seven_strips_of_60_s_at_50_hz() -> None:
    load = os.getloadavg()[0]
    with file_server() as origin, open_chromium() as browser:
        ours = harness(browser, origin)
        ours.evaluate(OURS)
        print(f"\n7 strips x 3,000 samples a frame, load {load:.1f}: {measured(ours)}")
        hour = harness(browser, origin)
        hour.evaluate(OURS)
        hour.evaluate(
            "() => { harness.feed(60, 3600, 0); harness.timeline.setWindow(0, 3600);"
            " bench.draw = () => { harness.timeline.pan(0.01, 0); harness.draw(3.6e6); } }"
        )
        print(f"the whole hour in view, 7 x 180,000 samples: {measured(hour)}")


def test_uplot_on_the_same_seven_strips() -> None:
    folder = Path(os.environ.get("UPLOT", "no folder given"))
    if not (folder / "uPlot.iife.min.js").exists():
        pytest.skip("no uPlot: npm install uplot in any folder, and set UPLOT to its dist folder")
    source = (folder / "uPlot.iife.min.js").read_text()
    css = (folder / "uPlot.min.css").read_text()
    with file_server() as origin, open_chromium() as browser:
        ours = harness(browser, origin)
        ours.evaluate(OURS)
        peer = harness(browser, origin)
        peer.evaluate(f"(() => {{ {source}; window.uPlot = uPlot; }})()")
        peer.evaluate(PEER, [source, css])
        for _ in range(5):
            ours.bring_to_front()
            print(f"\nours: {measured(ours)}")
            peer.bring_to_front()
            print(f"uPlot: {measured(peer)}")


def heap(page: Page) -> dict[str, Any]:
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")


def test_memory_over_three_hours_of_samples() -> None:
    with file_server() as origin, open_chromium() as browser:
        page = harness(browser, origin)
        lines = []
        feed = """
        (hour) => {
          const begin = performance.now();
          let pushing = 0;
          for (let t = 3600 * hour; t < 3600 * (hour + 1); t += 10) {
            const mark = performance.now();
            harness.feed(t, t + 10, 1000 * t);
            pushing += performance.now() - mark;
            harness.draw(1000 * (t + 10));
          }
          return [pushing, performance.now() - begin];
        }
        """
        for hour in range(3):
            pushing, total = page.evaluate(feed, hour)
            used = heap(page)
            lines.append(
                f"after {hour + 1} h (180,000 samples each): heap {used['usedSize'] / 1e6:.2f} MB, "
                f"arrays {used['backingStorageSize'] / 1e6:.2f} MB; fed in {pushing / 1e3:.1f} s "
                f"({1e3 * pushing / 180_000:.1f} µs a sample), with 360 frames {total / 1e3:.1f} s"
            )
        print("\n" + "\n".join(lines))


MANY = """
() => {
  const h = window.harness;
  const channels = Array.from({ length: 29 }, (_, k) => ({ ...h.CHANNELS[k % 6], key: `c${k}` }));
  const host = Object.assign(document.createElement('div'), { id: 'many' });
  document.querySelector('#strips').replaceWith(host);
  document.querySelector('.cross-panel').remove();
  const timeline = h.createTimeline({ seconds: 600, dt: 0.02 });
  const options = { channels, timeline, autostart: false, alertAbove: 0.1 };
  const chart = h.createFlightChart(host, options);
  host.after(chart.cross);
  host.style.minHeight = '1500px';
  for (const turn of host.querySelectorAll('.strip-fold[aria-expanded=false]')) turn.click();
  for (let k = 0; k < 2; k++)
    document.querySelector('[aria-label="Add a cross plot"]').click();
  const frame = (t) => {
    const { y, ...rest } = h.frame(t);
    return { ...rest, y_hat: null, y: channels.map((_, k) => y[k % 6]) };
  };
  const feed = (from, to) => {
    for (let k = Math.ceil(50 * from - 1e-6); k < 50 * to - 1e-6; k++)
      chart.push([frame(k / 50)], 20 * k);
  };
  feed(0, 600);
  let t = 600;
  window.bench = {
    draw: () => {
      feed(t, t + 1 / 30);
      t += 1 / 30;
      chart.update(1000 * t);
    },
    canvases: () => [...document.querySelectorAll('#many canvas, .cross-panel canvas')],
  };
  chart.update(1000 * t);
  return bench.canvases().filter((canvas) => canvas.getBoundingClientRect().height > 0).length;
}
"""


def test_thirty_strips_of_ten_minutes_and_two_cross_plots() -> None:
    with file_server() as origin, open_chromium() as browser:
        page = harness(browser, origin)
        drawn = page.evaluate(MANY)
        print(f"\n{drawn} canvases, 30,000 samples in each strip: {measured(page)}")
