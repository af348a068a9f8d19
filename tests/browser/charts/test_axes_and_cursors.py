"""Axes, clock, cursors, zoom and pan of the live strips; what each canvas says in words."""

import re

import pytest
from playwright.sync_api import Page

from tests.browser.chromium import wait_until
from tests.browser.strips import GUTTER, Open, plot_width, readout, run


def test_the_value_axis_widens_at_once_and_narrows_only_after_a_while(strips: Open) -> None:
    ranges = run(
        strips(),
        """
        const axis = h.createValueAxis({});
        const seen = [];
        const fit = (size, wall) => {
          axis.fit(-size, size, wall);
          seen.push([axis.low, axis.high]);
        };
        fit(1, 0); fit(1.02, 1000); fit(0.9, 2000);
        fit(0.1, 3000); fit(0.1, 6000); fit(0.1, 7500); fit(0.1, 9000);
        return seen;
        """,
    )
    first = ranges[0]
    assert first[0] <= -1.02
    assert first[1] >= 1.02
    assert all(later == first for later in ranges[1:5])
    assert ranges[6][1] < 0.3


def test_limits_are_always_in_view(strips: Open) -> None:
    low, high = run(
        strips(),
        """
        const axis = h.createValueAxis({ limits: [-0.5, 0.5] });
        axis.fit(0, 0.01, 0);
        return [axis.low, axis.high];
        """,
    )
    assert low < -0.5
    assert high > 0.5


def test_the_live_edge_never_runs_backwards_over_jittered_arrivals(strips: Open) -> None:
    steps = run(
        strips(),
        """
        const timeline = h.createTimeline({});
        const edges = [];
        let [seed, wall] = [5, 0];
        for (let k = 0; k < 2000; k++) {
          seed = (seed * 16807) % 2147483647;
          wall = Math.max(wall, 1000 + 20 * k + Math.max(0, (seed / 2147483647) * 200 - 150));
          timeline.observe(k / 50, wall);
          edges.push(timeline.now(wall));
        }
        const steps = edges.slice(1).map((edge, k) => edge - edges[k]);
        return [Math.min(...steps), edges.at(-1)];
        """,
    )
    assert steps[0] >= 0
    assert steps[1] == pytest.approx(1999 / 50, abs=0.1)


def test_arrow_keys_move_the_cursor_and_a_b_show_differences(strips: Open) -> None:
    page = strips("seconds=4")
    run(page, "h.feed(0, 10, 1000, { growth: 0.1 }); h.draw(1000)")
    page.locator("#strips").focus()
    page.keyboard.press("End")
    page.keyboard.press("a")
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("b")
    run(page, "h.draw(1000)")
    marks = run(page, "return h.timeline.marks")
    assert marks["a"] == pytest.approx(9.98)
    assert marks["a"] - marks["b"] == pytest.approx(11 * 0.02, abs=1e-6)
    assert "Δt −0.220 s" in page.locator(".strip-cursors").inner_text()
    a, b = (run(page, f"return h.chart.values(h.timeline.marks.{name}).p") for name in "ab")
    text = readout(page, "p", "detail").replace("−", "-")
    shown = [float(word) for word in re.findall(r"-?\d+\.\d+", text)]
    assert shown == pytest.approx([a, b, b - a], abs=6e-4)
    page.keyboard.press("c")
    assert run(page, "return Number.isNaN(h.timeline.marks.a)")


def test_every_strip_shows_its_values_at_the_cursors(strips: Open) -> None:
    page = strips("seconds=4")
    run(
        page,
        "h.feed(0, 10, 1000); for (const [name, t] of [['a', 8.2], ['b', 9]])"
        " h.timeline.setMark(name, t); h.draw(1000)",
    )
    for row in page.locator(".strip .readout-detail").all():
        assert re.fullmatch(r"A .+  B .+  Δ .+", row.inner_text())


def test_the_wheel_zooms_and_live_stays_live(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 30, 1000); h.draw(1000)")
    page.locator(".strip canvas").first.hover(position={"x": 200, "y": 20})
    page.mouse.wheel(0, -400)
    wait_until(page, "harness.timeline.view(1000).end - harness.timeline.view(1000).start < 15")
    seen = run(page, "return h.timeline.view(1000)")
    assert seen["live"]
    assert seen["end"] == pytest.approx(29.98 + 0.5)


def test_a_held_window_zooms_about_the_pointer(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 30, 1000); h.timeline.setWindow(5, 15); h.draw(1000)")
    page.locator(".strip canvas").first.hover(position={"x": GUTTER + 200, "y": 20})
    under = 5 + 10 * 200 / plot_width(page)
    page.mouse.wheel(0, -300)
    wait_until(page, "harness.timeline.view(1000).start > 5.01")
    seen = run(page, "return h.timeline.view(1000)")
    share = (under - seen["start"]) / (seen["end"] - seen["start"])
    assert share == pytest.approx(200 / plot_width(page), abs=0.01)


def test_dragging_holds_the_window_and_a_double_click_goes_live(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.draw(1000)")
    box = page.locator(".strip canvas").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 30, steps=5)
    page.mouse.up()
    seen = run(page, "h.draw(1000); return h.timeline.view(1000)")
    assert not seen["live"]
    assert seen["end"] == pytest.approx(59.98 + 0.5 - 100 * 20 / plot_width(page), abs=0.3)
    assert "s behind" in page.locator(".strip-interval").inner_text()
    page.mouse.dblclick(box["x"] + 300, box["y"] + 30)
    assert run(page, "return h.timeline.view(1000).live")


def test_a_click_pins_a_cursor_that_all_strips_share(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.timeline.setWindow(20, 40); h.draw(1000)")
    page.locator(".strip canvas").first.click(
        position={"x": GUTTER + plot_width(page) / 2, "y": 30}
    )
    page.mouse.move(5, 5)
    assert run(page, "return h.timeline.cursorAt(h.timeline.view(1000))") == pytest.approx(
        30, abs=0.1
    )
    run(page, "h.draw(1000)")
    for key in ("beta", "risk"):
        assert readout(page, key, "detail").startswith("cursor")


def test_every_canvas_says_its_value_and_state_once_a_second(strips: Open) -> None:
    page = strips()
    run(page, "h.feed(0, 5, 1000); h.draw(1000)")
    canvas = page.locator('.strip[data-key="Ny"] canvas')
    first = canvas.get_attribute("aria-label")
    assert first is not None
    assert re.fullmatch(r"lateral acceleration N_y: −?\d\.\d{3} g, ok, limit ±0\.5 g", first)
    run(page, "h.feed(5, 5.5, 1500); h.draw(1500)")
    assert canvas.get_attribute("aria-label") == first
    run(page, "h.draw(2600)")
    assert "stale for" in (canvas.get_attribute("aria-label") or "")
    assert page.locator("canvas:not([aria-label]):not([aria-hidden])").count() == 0


VIEW = "(({ start, end }) => [start, end])(harness.timeline.view(1000))"


def shows(page: Page, start: float, end: float) -> None:
    """Wait until the window is this one: the browser's history takes a moment."""
    wait_until(page, f"(([a, b]) => Math.hypot(a - {start}, b - {end}) < 1e-3)({VIEW})")


def test_each_zoom_can_be_undone_and_done_again(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.timeline.setWindow(20, 40); h.draw(1000)")
    page.locator("#strips").focus()
    for key, window in [
        ("+", (25, 35)),
        ("+", (27.5, 32.5)),
        ("z", (25, 35)),
        ("z", (20, 40)),
        ("z", (20, 40)),  # nothing before it
        ("y", (25, 35)),
        ("y", (27.5, 32.5)),
        ("z", (25, 35)),
        ("PageDown", (30, 40)),
        ("y", (30, 40)),  # nothing is ahead of a new window
        ("z", (25, 35)),
    ]:
        page.keyboard.press(key)
        shows(page, *window)


def test_the_browsers_back_and_forward_undo_zooms(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.draw(1000)")
    page.locator("#strips").focus()
    page.keyboard.press("PageUp")
    held = page.evaluate(VIEW)
    page.keyboard.press("a")
    page.keyboard.press("+")
    zoomed = page.evaluate(VIEW)
    page.go_back()
    shows(page, *held)
    assert run(page, "return h.timeline.marks.a") == pytest.approx(59.98)
    page.go_forward()
    shows(page, *zoomed)
    page.go_back()
    page.go_back()
    wait_until(page, "harness.timeline.view(1000).live")
    assert run(page, "return h.timeline.view(1000).end") == pytest.approx(60.48)


def test_a_drag_is_one_step_back(strips: Open) -> None:
    page = strips("seconds=20")
    run(page, "h.feed(0, 60, 1000); h.timeline.setWindow(20, 40); h.draw(1000)")
    box = page.locator(".strip canvas").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 300, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 20, steps=8)
    page.mouse.up()
    assert run(page, "return h.timeline.view(1000).start") > 21
    page.keyboard.press("z")
    shows(page, 20, 40)
