"""Monitor sets on the page: made, flown, and the monitor in use named on the status strip."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from core.channels import KEYS
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import collect
from tests.browser.fly.test_fly_page import RECIPE, Fly, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]


def push(fly: Fly, first: int, mach: float | None) -> None:
    """Five samples at rest."""
    t = [round(RECIPE.dt * k, 6) for k in range(first, first + 5)]
    body = {key: [0.0] * 5 for key in KEYS} | {"sequence": first, "t": t, "mach": [mach] * 5}
    fly.ask("POST", f"/flights/{fly.flight}/samples", body)


@pytest.mark.parametrize("width", [1024, 1440])
def test_a_set_is_made_flown_and_says_which_monitor_it_uses(
    page: Page, site: Site, allowed_errors: list[str], width: int, tmp_path: Path
) -> None:
    allowed_errors += ["422 (Unprocessable", "409 (Conflict"]
    page.set_viewport_size({"width": width, "height": 800})
    fast = f"fast doublet {width}"
    site.store.monitors.add(train(collect(RECIPE), MonitorRecipe(epsilon=0.2)), fast)
    page.goto(f"{site.http}/#/monitors")
    page.get_by_role("link", name="Monitor sets").click()
    form = page.locator("form.panel")
    form.get_by_label("Name", exact=True).fill(f"doublet {width}")
    for k, (name, low, high, monitor) in enumerate(
        (("slow", "", "0.8", "doublet (0.25 s ahead)"), ("fast", "", "1.2", fast))
    ):
        case = form.locator("fieldset").nth(k)
        case.get_by_label("Name of the condition").fill(name)
        case.get_by_label("Mach number from").fill(low)
        case.get_by_label("Mach number below").fill(high)
        choice = case.get_by_label("Monitor", exact=True)
        words = choice.locator("option", has_text=monitor).first.inner_text()
        choice.select_option(words)
    form.get_by_role("button", name="Create the monitor set").click()
    expect(form.get_by_role("alert").last).to_contain_text("includes")
    form.get_by_label("Mach number from").last.fill("0.8")
    form.get_by_role("button", name="Create the monitor set").click()
    rows = page.get_by_role("region", name="Conditions").locator("tbody tr")
    expect(rows).to_have_count(2)
    expect(rows.last).to_contain_text("from 0.8, below 1.2")
    expect(rows.last).to_contain_text(fast)
    page.screenshot(path=tmp_path / "set.png")
    page.get_by_role("link", name="Fly it").click()
    expect(page.get_by_label("Monitor", exact=True)).to_contain_text(f"doublet {width}")
    expect(page.get_by_label("ε, accepted miss rate")).to_be_hidden()
    expect(page.get_by_label("Mach number")).to_be_visible()
    page.get_by_role("button", name="Start the flight").click()
    fly = Fly(page, site)
    fly.connected()
    fly.flight = page.url.rsplit("/", 1)[-1]
    line = page.get_by_label("Monitor in use")
    expect(fly.status("monitor")).to_have_text("◆ none")
    expect(line).to_contain_text("◆ NO MONITOR IN USE: Mach number is missing")
    address = page.locator(".source-address")
    expect(address.locator("tr", has_text="Mach number")).to_contain_text("mach")
    expect(address.locator("tr", has_text="Mach number")).to_contain_text("✓ flight condition")
    expect(address.locator("code", has_text="curl")).to_contain_text('"mach":0')
    page.screenshot(path=tmp_path / "address.png")
    push(fly, 0, 0.6)
    expect(fly.status("monitor")).to_have_text("slow: doublet")
    expect(line).to_contain_text(f"Monitor in use: doublet, for slow · monitor set doublet {width}")
    push(fly, 5, 0.9)
    expect(fly.status("monitor")).to_have_text(f"fast: {fast}")
    level = page.locator(".risk-gauge").get_by_text(re.compile("(above|>) 0.2$"))
    expect(level.filter(visible=True)).to_have_count(1)
    expect(fly.event(f"monitor in use: {fast}")).to_be_visible()
    page.screenshot(path=tmp_path / "flight.png")
    push(fly, 10, 1.3)
    expect(line).to_contain_text("◆ NO MONITOR IN USE: no monitor for this Mach number")
    expect(level.filter(visible=True)).to_have_count(0)
    expect(fly.event("no monitor in use: no monitor for this Mach number")).to_be_visible()
    page.screenshot(path=tmp_path / "none.png")
    page.reload()
    fly.connected()
    expect(line).to_contain_text("NO MONITOR IN USE")
    fly.end()
    record = page.locator(".event", has_text="monitor in use")
    expect(record).to_have_count(4)
    expect(fly.status("monitor")).to_have_text(f"doublet {width}")
