"""A whole campaign on the page, from card to clearance to live flight to report; its refusals."""

import json
import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from app.campaigns import clearing
from app.campaigns.point import Clearing, FlownPoint
from app.campaigns.stored import Campaigns
from core.channels import KEYS
from core.clearance.clearance import ClearanceRecipe
from core.clearance.with_monitor import WithMonitor
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from tests.browser.fly.test_fly_page import Fly, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]
pytestmark = pytest.mark.usefixtures("few_flights")
TEST = {
    "aircraft": {"kind": "attas_id_16kft"},
    "control_law": {"kind": "none"},
    "limits": {"Ny": 0.305},
    "noise": {"Ny": 0.003, "p": 0.002, "r": 0.002, "beta": 0.001, "delta_a": 4e-4, "delta_r": 4e-4},
    "maneuver": {"amplitude_jitter": 0.1},
    "imperfections": "none",
    "n_unsafe": 60,
}
QUICK = {"n_exceeding": 20, "n_aircraft": 100}
LONG = 120_000
"""[ms] Clearances and trainings on a busy machine."""


class Campaign(Fly):
    """The page of a campaign."""

    def plan(self, steps: list[float]) -> None:
        plan = {"name": "Rudder", "conditions": [{"dataset": TEST, "steps": steps}]}
        self.id = self.ask("POST", "/campaigns", plan | {"clearance": QUICK})["id"]
        self.open()

    def hold(self) -> None:
        """After a step of 50 %, the full amplitude is on hold: 90 % may be reached."""
        self.plan([0.5, 1.0])
        campaigns = Campaigns(self.site.store)
        stored, planned = campaigns.get(self.id)
        amplitude = 0.9 * planned.points[1].peak_deg
        computed = Clearing(
            False, 0.2, 0.1, (0.7, 0.9, 1.1), amplitude, (), 210, 1_000, ClearanceRecipe(), ("50%",)
        )
        test = planned.conditions[0].test
        samples = self.samples()[-test.maneuver.n_samples(test.dt) :]
        flown = FlownPoint("flight.csv", tuple(map(tuple, samples.tolist())), 0.5)
        held = planned.changed(0, "complete", "Bob", flown=flown)
        campaigns.put(stored, held.changed(1, "hold", "Ann", clearing=computed))
        self.state("hold")

    def open(self) -> None:
        self.page.goto(f"{self.site.http}/#/campaigns/{self.id}")
        expect(self.next).to_be_visible()

    @property
    def next(self) -> Locator:
        return self.page.get_by_role("region", name="Next point")

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def state(self, words: str) -> None:
        expect(self.next.get_by_role("heading", level=2).locator("..")).to_contain_text(words)

    def samples(self) -> Any:
        """(n, 6) of the next point, flown by the nominal aircraft after rest."""
        _, campaign = Campaigns(self.site.store).get(self.id)
        planned = campaign.test_of(campaign.next.point)
        assert isinstance(planned, DatasetRecipe)
        simulator = LateralSimulator(planned)
        theta = simulator.plant.nominal[np.newaxis]
        y = simulator.fly(theta, np.random.default_rng(1))[0].y[0]
        return np.vstack([np.zeros((60, 6)), y])

    def made_recording(self) -> str:
        """Id of what its live flight became, which is made in the background."""
        for _ in range(600):
            if made := self.ask("GET", f"/flights/{self.flight}")["recording"]:
                return made
            self.page.wait_for_timeout(50)
        raise AssertionError("no recording was made")

    def complete(self, recording: str) -> None:
        self.page.get_by_text("Attach the flight recording").click()
        self.page.get_by_label("recording", exact=True).select_option(recording)
        self.press("Complete")

    def row(self, point: str) -> Locator:
        return self.page.locator(f'tr[data-point="{point}"]')


@pytest.fixture
def campaign(page: Page, site: Site) -> Campaign:
    return Campaign(page, site)


def test_a_campaign_goes_from_card_to_clearance_to_live_flight_to_report(
    campaign: Campaign,
) -> None:
    page = campaign.page
    campaign.plan([0.6, 0.78, 1.0])
    campaign.state("Next: 60%, 3.84 degplanned")
    campaign.press("Clear")
    expect(campaign.next.locator(".field .error").first).to_contain_text("No name was given")
    page.get_by_label("your name").fill("Ann")
    campaign.press("Clear")
    campaign.state("cleared")

    text = "\n".join(
        [
            "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad",
            *(
                ",".join(f"{value:.9g}" for value in (0.05 * k, *row))
                for k, row in enumerate(campaign.samples())
            ),
        ]
    )
    sent = page.request.post(
        f"{campaign.site.http}/api/v1/recordings?name=first.csv", data=text.encode()
    )
    assert sent.ok, sent.text()
    campaign.open()
    campaign.complete(sent.json()["id"])
    campaign.state("Next: 78%")
    expect(campaign.row("60%")).to_contain_text("complete")
    expect(campaign.row("60%").get_by_role("link", name="recording")).to_be_visible()
    expect(page.get_by_text("Derivatives, after 60%")).to_be_visible()

    page.reload()
    expect(page.get_by_label("your name")).to_have_value("Ann")
    campaign.press("Compute clearance")
    expect(campaign.next).to_have_attribute("data-state", "on condition", timeout=LONG)
    expect(campaign.next).to_contain_text("Largest recommended amplitude")
    confirm = page.get_by_role("button", name="Confirm as cleared")
    expect(confirm).to_be_disabled()
    boxes = campaign.next.get_by_role("checkbox")
    expect(boxes).to_have_count(5)
    expect(campaign.next).to_contain_text("one step cannot reveal a nonlinear aircraft")
    for box in boxes.all():
        box.check()
    confirm.click()
    campaign.state("cleared")

    campaign.press("Train a monitor")
    expect(campaign.row("78%").get_by_role("link", name="monitor")).to_be_visible(timeout=LONG)
    (monitor,) = [m for m in campaign.ask("GET", "/monitors") if m["name"] == "Rudder, 78%"]
    campaign.row("78%").get_by_role("link", name="monitor").click()
    expect(page.locator(".facts").first).to_contain_text("60% (first.csv, ")

    campaign.open()
    page.get_by_role("link", name="Fly live").click()
    expect(page.locator("select#monitor")).to_have_value(monitor["id"])
    page.get_by_role("button", name="Start the flight").click()
    campaign.connected()
    campaign.flight = page.url.rsplit("/", 1)[-1]
    y = campaign.samples()
    for sequence, first in enumerate(range(0, len(y), 20), start=1):
        some = y[first : first + 20]
        batch = {"sequence": sequence, "t": [0.05 * (first + k) for k in range(len(some))]}
        batch |= {key: column.tolist() for key, column in zip(KEYS, some.T, strict=True)}
        campaign.ask("POST", f"/flights/{campaign.flight}/samples", batch)
    campaign.end()
    recording = campaign.made_recording()
    campaign.open()
    campaign.complete(recording)
    campaign.state("Next: 100%")
    row = campaign.row("78%")
    expect(row).to_contain_text("complete")
    expect(row.get_by_role("link", name="flight")).to_have_attribute(
        "href", f"#/fly/{campaign.flight}"
    )
    expect(page.get_by_text("Derivatives, after 60%, 78%")).to_be_visible()
    report = page.request.get(f"{campaign.site.http}/api/v1/campaigns/{campaign.id}/report").text()
    assert "Next: 100%" in report
    assert "identified from 60%, 78%" in report
    page.get_by_role("link", name="Campaigns", exact=True).click()
    row = page.get_by_role("row").filter(has_text="2 of 3")
    expect(row.get_by_role("link", name="Rudder")).to_be_visible()


def test_a_page_follows_what_others_decide_and_says_when_it_cannot_know(
    campaign: Campaign, allowed_errors: list[str]
) -> None:
    allowed_errors += ["ERR_FAILED", "Failed to fetch"]
    page = campaign.page
    campaign.plan([0.5, 1.0])
    campaign.ask("POST", f"/campaigns/{campaign.id}/hold", {"point": "50%", "by": "Ben"})
    campaign.state("hold")
    page.get_by_label("reason").fill("wind is down")
    campaign.ask("POST", f"/campaigns/{campaign.id}/confirm", {"point": "50%", "by": "Ben"})
    told = page.get_by_role("alert").filter(has_text="changed elsewhere")
    expect(told).to_be_visible()
    pattern = f"**/api/v1/campaigns/{campaign.id}"
    page.route(pattern, lambda _: None)  # a server that hangs
    campaign.ask("POST", f"/campaigns/{campaign.id}/hold", {"point": "50%", "by": "Ben"})
    expect(page.get_by_role("alert").filter(has_text="no answer for")).to_be_visible()
    expect(page.locator(".page[data-lost]")).to_have_count(1)
    page.unroute(pattern)


def test_a_point_aborted_in_flight_links_to_its_recording(
    campaign: Campaign, allowed_errors: list[str]
) -> None:
    allowed_errors.append("409 (Conflict")
    page = campaign.page
    campaign.plan([0.5, 1.0])
    text = "t_s,ay_g\n" + "".join(f"{0.05 * k:g},{0.2 if k == 50 else 0.0}\n" for k in range(99))
    sent = page.request.post(
        f"{campaign.site.http}/api/v1/recordings?name=gust.csv", data=text.encode()
    )
    page.get_by_label("your name").fill("Ann")
    page.get_by_text("Attach the flight recording").click()
    page.get_by_label("recording", exact=True).select_option(sent.json()["id"])
    campaign.press("Aborted in flight")
    expect(campaign.next.locator(".field", has_text="reason")).to_contain_text("say why")
    page.get_by_label("reason").fill("gust")
    campaign.press("Aborted in flight")
    row = campaign.row("50%")
    expect(row).to_contain_text(re.compile("◆ 66.%, aborted"))
    expect(row).to_contain_text("Ann")
    expect(row.get_by_role("link", name="recording")).to_be_visible()
    expect(campaign.next).to_contain_text("The step before, 50%, was aborted: it reached 66")


def test_a_smaller_step_is_flown_before_a_refused_point(campaign: Campaign) -> None:
    page = campaign.page
    campaign.hold()
    expect(campaign.next).to_contain_text("Proposed: fly 90%")
    page.get_by_label("your name").fill("Ann")
    campaign.press("Fly 90% first")
    expect(campaign.next.get_by_role("heading", level=2)).to_contain_text("Next: 90%")
    expect(campaign.row("90%")).to_contain_text("planned: Ann")
    expect(page.get_by_role("button", name="Compute clearance", exact=True)).to_be_visible()


def test_a_point_on_hold_is_computed_with_its_monitor(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    risks = np.full(120, 0.3)
    monkeypatch.setattr(clearing, "with_monitor", lambda rule, *_: WithMonitor(rule.recipe, risks))
    campaign.hold()
    campaign.page.get_by_label("your name").fill("Ann")
    campaign.press("Compute with its monitor")
    expect(campaign.next).to_contain_text("With its monitor at ε", timeout=LONG)
    expect(campaign.next).to_contain_text("flown without an alert in time")
    expect(campaign.next).to_contain_text("Cleared up to p-value0.5")
    expect(campaign.page.get_by_text("exceedance without an alert in time")).to_be_visible()
    expect(campaign.page.get_by_role("button", name="Compute with its monitor")).to_have_count(0)


def test_the_list_follows_what_is_decided(campaign: Campaign) -> None:
    campaign.plan([0.5, 1.0])
    campaign.page.goto(f"{campaign.site.http}/#/campaigns")
    row = campaign.page.get_by_role("row").filter(has_text="Rudder").first
    expect(row).to_contain_text("planned")
    campaign.ask("POST", f"/campaigns/{campaign.id}/hold", {"point": "50%", "by": "Ben"})
    expect(row).to_contain_text("hold")


def test_long_names_are_wrapped(campaign: Campaign) -> None:
    """Of the campaign in the list, and of who decided on its page, its card and its report."""
    name, by = "W" * 200, "A" * 100
    plan = {"name": name, "conditions": [{"dataset": TEST, "steps": [0.5, 1.0]}]}
    path = f"/campaigns/{campaign.ask('POST', '/campaigns', plan | {'clearance': QUICK})['id']}"
    campaign.ask("POST", f"{path}/confirm", {"point": "50%", "by": by})
    campaign.page.set_viewport_size({"width": 1024, "height": 700})
    for url, words in (("#/campaigns", name), (f"#{path}", by), (f"api/v1{path}/report", by)):
        campaign.page.goto(f"{campaign.site.http}/{url}")
        expect(campaign.page.get_by_text(words).first).to_be_visible()
        wide = campaign.page.evaluate(
            "[...document.querySelectorAll('*')].filter((e) => e.offsetWidth &&"
            " e.scrollWidth > e.clientWidth + 1).map((e) => e.outerHTML.slice(0, 60))"
        )
        assert not [one for one in wide if one.startswith(("<html", "<body", "<section", "<div"))]


def test_a_clearance_under_way_is_seen_by_who_comes_later(campaign: Campaign) -> None:
    campaign.plan([0.5, 1.0])
    page = campaign.page
    job = {"id": "1", "kind": "clearance", "status": "running", "message": "3 of 9 identified"}
    job |= {"request": {"campaign": campaign.id, "point": "100%"}, "progress": 3, "total": 9}
    events = f"data: {json.dumps(job)}\n\n"
    page.route("**/api/v1/jobs", lambda route: route.fulfill(json=[job]))
    page.route(
        "**/jobs/1/events",
        lambda route: route.fulfill(body=events, content_type="text/event-stream"),
    )
    page.reload()
    expect(campaign.next).to_contain_text("3 of 9 identified")
    page.unroute("**/api/v1/jobs")
    page.unroute("**/jobs/1/events")


def test_a_campaign_is_planned_on_the_page_and_refused_with_words(
    campaign: Campaign, allowed_errors: list[str]
) -> None:
    # the page may ask once more for the campaign that it deletes
    allowed_errors += ["422 (Unprocessable", "404 (Not Found)"]
    page = campaign.page
    page.goto(f"{campaign.site.http}/#/campaigns/new")
    page.get_by_role("button", name="Plan the campaign").click()
    named = page.locator(".field", has_text="name of the campaign")
    expect(named).to_contain_text("No name was given")
    page.get_by_label("name of the campaign").fill("Doublets")
    steps = page.get_by_label("steps, as shares of the amplitude")
    for wrong, words in (
        ("a b", "“a b” was given: give numbers"),
        ("0.8 0.4", "one sign and grow"),
        ("1 2 3", "1 2 3 was given: each is a share"),
    ):
        steps.fill(wrong)
        page.get_by_role("button", name="Plan the campaign").click()
        expect(page.locator(".field", has=steps)).to_contain_text(words)
    steps.fill("0,5 1")
    page.get_by_label("pass below").fill("0.9")
    page.get_by_role("button", name="Plan the campaign").click()
    campaign.state("Next: 50%")
    expect(campaign.next).to_contain_text("below 90 % of each limit")
    page.get_by_role("link", name="Add a flight condition").click()
    page.get_by_label("flight condition", exact=True).fill("Mach 0.6")
    page.get_by_role("button", name="Add points").click()
    expect(campaign.row("40% Mach 0.6")).to_contain_text("planned")
    expect(page.get_by_text("Build-up at Mach 0.6")).to_be_visible()
    campaign.press("Delete")
    campaign.press("Delete permanently")
    expect(page.get_by_role("heading", name="Campaigns")).to_be_visible()


def test_the_page_has_the_aircraft_trim_manoeuvre_and_limits(campaign: Campaign) -> None:
    campaign.plan([0.6, 1.0])
    plan = campaign.page.get_by_text("rudder doublet, 2 points up to")
    for words in ("ATTAS", "131 m/s", "lateral acceleration"):
        expect(plan).to_contain_text(words)
