"""The risk against time ahead on the page: a row a monitor, one of which raises the alarms."""

import pytest
from playwright.sync_api import Page, expect

from core.monitor import MonitorRecipe, train
from core.planned_test.collection import collect
from tests.browser.fly.test_fly_page import RECIPE, Fly, draw_no_scene, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]
LONG = "rudder doublet at sea level, trained again after the change of the yaw damper"


@pytest.fixture(scope="module")
def further(site: Site) -> str:
    """A monitor that looks further ahead."""
    monitor = train(collect(RECIPE), MonitorRecipe(t_early=0.5))
    return site.store.monitors.add(monitor, LONG).id


@pytest.mark.usefixtures("further")
def test_a_row_a_monitor_by_its_lead_and_which_raises_the_alarms(fly: Fly, site: Site) -> None:
    page = fly.page
    page.goto(f"{site.http}/#/fly")
    page.get_by_label("Monitor", exact=True).select_option(label=_label(page, "doublet (0.25"))
    page.get_by_text("Further monitors, for display").click()
    page.get_by_label("0.5 s ahead").check()
    page.get_by_role("button", name="Start the flight").click()
    page.locator('[data-flight="open"]').wait_for()
    fly.flight = page.url.rsplit("/", 1)[1]
    fly.steer("pause", None)
    fly.steer("seek", 1.5)
    rows = page.locator(".ahead-row")
    expect(rows.locator(".ahead-lead")).to_have_text(["0.25 s", "0.5 s"])
    expect(rows.locator(".ahead-role")).to_have_text(["raises the alarms", "display only"])
    expect(rows.locator(".ahead-name").last).to_have_attribute("title", LONG)
    frame = fly.ask("GET", f"/flights/{fly.flight}/assessments")["frames"][-1]
    risks = [frame["p_value"], frame["display"][0]["p_value"]]
    for row, risk in zip(rows.all(), risks, strict=True):
        expect(row.locator(".ahead-value")).to_contain_text(f"{risk:.{2 + (risk < 0.1)}f}")
    fly.steer("next_alert", None)
    alerting = page.locator(".ahead-row[data-alert]").first
    colour = "(row) => getComputedStyle(row.querySelector('.ahead-value')).color"
    expect(alerting.locator(".ahead-role")).to_have_text("raises the alarms")
    alarm = page.locator('[data-item="state"]').evaluate(
        "(state) => getComputedStyle(state).backgroundColor"
    )
    assert alerting.evaluate(colour) == alarm
    page.get_by_role("button", name="Compare the monitors").click()
    compared = page.locator(".comparison")
    expect(compared.locator("thead th").last).to_contain_text(f"{LONG}, ε 0.1")
    expect(page.locator(".readout-label", has_text=f"dashed: {LONG}")).to_be_visible()
    fly.end()
    page.get_by_role("button", name="Compare the monitors").click()
    monitors = fly.ask("GET", f"/flights/{fly.flight}/comparison")["monitors"]
    cells = compared.locator("tbody tr", has_text="Samples assessed").locator("td")
    expect(cells).to_have_text([str(monitor["n_assessed"]) for monitor in monitors])
    cells = compared.locator("tbody tr", has_text="Alerts at").locator("td")
    times = [[f"{alert['start']:.2f} s" for alert in monitor["alerts"]] for monitor in monitors]
    expect(cells).to_have_text([", ".join(each) or "none" for each in times])


def test_no_row_shows_a_number_while_nothing_comes(fly: Fly, site: Site, further: str) -> None:
    own = next(one["id"] for one in fly.ask("GET", "/monitors") if one["name"] == "doublet")
    source = {"kind": "live", "trim": "none"}
    asked = {"source": source, "monitor": own, "monitors": [further]}
    fly.flight = fly.ask("POST", "/flights", asked)["id"]
    fly.page.goto(f"{site.http}/#/fly/{fly.flight}")
    values = fly.page.locator(".ahead-value")
    expect(values).to_have_text(["NO DATA", "NO DATA"])
    channels = dict.fromkeys(("beta", "p", "r", "Ny", "delta_a", "delta_r"), [0.0] * 9)
    batch = {"t": [0.02 * k for k in range(9)], **channels}
    fly.ask("POST", f"/flights/{fly.flight}/samples", batch)
    expect(values).to_have_text(["STALE", "STALE"])


def _label(page: Page, begin: str) -> str:
    options = page.locator("#monitor option")
    expect(options.first).to_be_attached()
    return next(text for text in options.all_text_contents() if text.startswith(begin))


@pytest.mark.parametrize("size", [(1024, 768), (1440, 900), (1280, 720)])
def test_the_scene_is_at_least_280_px_high_beside_three_monitors(
    fly: Fly, site: Site, further: str, size: tuple[int, int]
) -> None:
    third = site.store.monitors.add(site.store.monitors.get(further), "a third monitor").id
    own = next(one["id"] for one in fly.ask("GET", "/monitors") if one["name"] == "doublet")
    source = {"kind": "simulated", "outcome": "unsafe", "seed": 1}
    asked = {"source": source, "monitor": own, "monitors": [further, third]}
    fly.flight = fly.ask("POST", "/flights", asked)["id"]
    fly.steer("pause", None)
    width, height = size
    fly.page.set_viewport_size({"width": width, "height": height})
    fly.page.goto(f"{site.http}/#/fly/{fly.flight}")
    fly.connected()
    expect(fly.page.locator(".ahead-row")).to_have_count(3)
    draw_no_scene(fly.page)
    fly.page.get_by_role("button", name="Show scene").click()
    frame = fly.page.locator(".scene-panel iframe")
    box = frame.bounding_box()
    assert box is not None
    assert box["height"] >= 280 - 2  # its border
    assert box["width"] >= 280
