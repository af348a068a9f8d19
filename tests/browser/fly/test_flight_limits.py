"""Limits in force on the page: named, changed by an engineer, and monitors that do not apply."""

import re

from playwright.sync_api import expect

from core.limits.limit_sets import LimitCase, LimitSet
from core.limits.limits import Limits
from tests.browser.fly.test_fly_page import SAFE, Fly, site, stored
from tests.browser.site import Site
from tests.browser.strips import Open

__all__ = ["site", "stored"]


def test_limits_are_changed_in_flight_and_a_monitor_of_others_says_no_number(
    fly: Fly, site: Site
) -> None:
    cases = (
        LimitCase("slow", {"mach": (None, 0.8)}, Limits(Ny=0.5)),
        LimitCase("fast", {"mach": (0.8, None)}, Limits(Ny=0.4)),
    )
    site.store.limit_sets.add("envelope", LimitSet(cases), "Ann")
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 1.0))
    line = page.locator(".flight-limits")
    expect(line).to_contain_text("Limits: the monitor's own, |Ny| 0.5 g")
    for mach, words in (
        ("", "◆ LIMITS UNKNOWN: Mach number is missing"),
        ("0.9", "fast: |Ny| 0.4 g"),
    ):
        line.get_by_role("button", name="Change limits").click()
        dialog = page.get_by_role("dialog")
        expect(dialog.get_by_label("Limits")).to_contain_text("envelope, version 1")
        dialog.get_by_label("Mach number").fill(mach)
        dialog.get_by_role("button", name="Put in force").click()
        expect(dialog).to_have_count(0)
        expect(line).to_contain_text(words)
    fly.steer("step", 1)
    fly.state_says("NOT APPLICABLE")
    expect(page.locator(".gauge-number")).to_have_text("")
    expect(page.locator(".alarm-banner")).to_contain_text("NOT APPLICABLE at 1.05 s: |Ny| 0.4 g")
    expect(
        page.locator(".event", has_text="limits in force: fast (envelope version 1")
    ).to_have_count(1)
    page.reload()
    expect(line).to_contain_text("fast: |Ny| 0.4 g")
    fly.state_says("NOT APPLICABLE")
    fly.end()
    record = page.locator(
        ".notice", has_text="Limits: envelope version 1, declared mach 0.9, put in"
    )
    expect(record).to_be_visible()
    strip = page.locator('.strip[data-key="Ny"] canvas')
    expect(strip).to_have_attribute("aria-label", re.compile("limit ±0.4"))
    assert [one["by"] for one in fly.ask("GET", f"/flights/{fly.flight}/limits")] == ["local"] * 2


def test_a_record_shows_the_limits_of_the_samples_that_it_shows(strips: Open) -> None:
    """Sought back at sample 50 to before the change at 30, and changed again at 60."""
    script = """async (held) => {
      const { heldDuring } = await import("/static/js/fly/record.js");
      const pass = (first, last) => [{ seq: first }, { seq: last }];
      return [pass(0, 49), pass(50, 80), pass(40, 45), pass(10, 20), []].map((frames) =>
        heldDuring(held, frames).map(({ t, limits }) => [t, limits?.Ny ?? null]));
    }"""
    changes = [(0, None, 0.5), (30, 2.9, 0.4), (50, None, 0.5), (60, 1.9, None)]
    held = [{"seq": seq, "t": t, "limits": ny and {"Ny": ny}} for seq, t, ny in changes]
    whole, after, late, early, none = strips().evaluate(script, held)
    assert whole == [[None, 0.5], [2.9, 0.4]]
    assert after == [[None, 0.5], [1.9, None]]
    assert (late, early) == ([[None, 0.4]], [[None, 0.5]])
    assert len(none) == 4
    dropped = [one for one in held if one["seq"] > 0]
    assert strips().evaluate(script, dropped)[3] == [[None, None]]
    of_before = [{**one, "seq": None} for one in held]
    assert len(strips().evaluate(script, of_before)[3]) == 4


def test_limits_are_unknown_between_the_monitors_of_a_set_that_share_none(strips: Open) -> None:
    script = """async (limit) => {
      const { createFlightLimits } = await import("/static/js/fly/flight_limits.js");
      const line = document.createElement("p");
      const limits = createFlightLimits(line, { api: { get: async () => [] }, path: "" });
      const ny = { key: "Ny", symbol: "N_y", display_unit: "g", display_factor: 1, limit };
      limits.show(null, [ny], { case: "", name: "by Mach" });
      return [line.textContent, line.hasAttribute("data-unknown")];
    }"""
    page = strips()
    words, is_unknown = page.evaluate(script, None)
    assert is_unknown
    assert words.startswith("◆ LIMITS UNKNOWN: no monitor of the set is in use")
    assert page.evaluate(script, 0.5)[1] is False
