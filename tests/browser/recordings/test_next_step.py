"""Where no monitor fits a recording, the page leads on to the training of one."""

import json
import re

import pytest
from playwright.sync_api import Page, expect

from core.monitor import Monitor
from tests.browser.recorded_site import RecordedSite
from tests.support.attas import record_file

AIRCRAFT = "attas_id_16kft"


def without(content: bytes, column: int) -> bytes:
    """The site's file without a column and without its bad row."""
    rows = [line.split(b",") for line in content.split(b"\n") if b"garbage" not in line]
    return b"\n".join(b",".join(row[:column] + row[column + 1 :]) for row in rows)


def field(page: Page, path: str):
    return page.locator(f'[name="{path}"]')


def choose_aircraft(page: Page) -> None:
    expect(page.get_by_role("heading", level=1)).to_have_text("Train a monitor")
    origin = page.get_by_role("region", name="From a recording")
    expect(origin).to_be_visible()
    expect(page.get_by_role("form", name="Train a monitor")).to_have_count(0)
    origin.get_by_label("Which aircraft was flown?").select_option(AIRCRAFT)
    expect(field(page, "dataset.aircraft.kind")).to_have_value(AIRCRAFT)


def test_after_invalid_a_training_form_is_filled_from_the_recording(
    scored: Page, site: RecordedSite, recording: str
) -> None:
    proposal = site.ask("GET", f"/recordings/{recording}/training-proposal")
    offer = scored.get_by_role("region", name="Next step")
    expect(offer).to_contain_text("INVALID")
    expect(offer.locator("li")).to_have_count(len(proposal["reasons"]))
    offer.get_by_role("link", name="Train a monitor for this manoeuvre").click()
    choose_aircraft(scored)
    flown = proposal["recipe"]["dataset"]["maneuver"]
    expect(field(scored, "dataset.maneuver.kind")).to_have_value(flown["kind"])
    amplitude = field(scored, "dataset.maneuver.amplitude_deg")
    assert float(amplitude.input_value()) == pytest.approx(flown["amplitude_deg"])
    expect(field(scored, "dataset.limits.Ny")).to_have_value("0.2")
    expect(field(scored, "dataset.maneuver.amplitude_jitter")).to_have_value("0.15")
    expect(field(scored, "dataset.n_unsafe")).to_have_value("500")


def test_a_real_record_that_no_monitor_fits_leads_to_its_card(
    page: Page, site: RecordedSite
) -> None:
    made = site.upload("attas_rud1.csv", record_file("attas_rud1").read_bytes())
    site.confirm(made)
    page.goto(f"{site.http}/#/monitors/new?recording={made}")
    choose_aircraft(page)
    expect(field(page, "dataset.maneuver.kind")).to_have_value("rudder_doublet")
    assert -5 < float(field(page, "dataset.maneuver.amplitude_deg").input_value()) < -2
    site.ask("DELETE", f"/recordings/{made}")


def test_a_monitor_trained_for_a_recording_is_chosen_to_score_it(
    page: Page, site: RecordedSite, attas: Monitor
) -> None:
    made = site.upload("again.csv")
    site.confirm(made)
    trained = site.store.monitors.add(attas, "trained for it").id
    site.score(made)
    job = {"id": "none", "request": {"name": "trained for it"}, "status": "queued"}
    ended = {**job, "status": "done", "message": "", "result": {"monitor": trained}}
    page.route(
        "**/api/v1/monitors",
        lambda route: (
            route.fulfill(status=202, json=job)
            if route.request.method == "POST"
            else route.fallback()
        ),
    )
    page.route(
        "**/jobs/none/events",
        lambda route: route.fulfill(
            body=f"data: {json.dumps(ended)}\n\n", content_type="text/event-stream"
        ),
    )
    page.goto(f"{site.http}/#/monitors/new?recording={made}")
    choose_aircraft(page)
    page.get_by_role("button", name="Train", exact=True).click()
    page.wait_for_url(f"**/recordings/{made}?monitor={trained}")
    expect(page.get_by_label("trained for it", exact=True)).to_be_checked()
    expect(page.get_by_label("transport doublet", exact=True)).not_to_be_checked()
    expect(page.get_by_role("form", name="Score")).to_be_in_viewport()
    page.get_by_label("trained for it", exact=True).uncheck()
    page.get_by_role("button", name="Score", exact=True).click()
    expect(page.get_by_text("Choose at least one monitor")).to_be_in_viewport()
    page.unroute_all()
    site.store.monitors.delete(trained)
    site.ask("DELETE", f"/recordings/{made}")


def test_without_a_channel_the_method_that_works_without_it_is_offered(
    page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    made = site.upload("no sideslip.csv", without(site.file, 1))
    site.confirm(made)
    page.goto(f"{site.http}/#/recordings/{made}")
    expect(page.locator(".monitor-refused")).to_contain_text("beta")
    expect(page.locator(".monitor-choice input:checked")).to_have_count(0)
    offer = page.get_by_role("region", name="Next step")
    expect(offer).to_contain_text("No monitor fits this recording")
    expect(offer).to_contain_text("β")
    offer.get_by_role("link", name="Train a monitor for this manoeuvre").click()
    choose_aircraft(page)
    expect(field(page, "monitor.predictor.kind")).to_have_value("last_output")
    expect(field(page, "monitor.score.kind")).to_have_value("negative_magnitude")
    site.ask("DELETE", f"/recordings/{made}")


def test_without_the_limited_channel_no_training_is_offered(
    page: Page, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    made = site.upload("no acceleration.csv", without(site.file, 4))
    site.confirm(made)
    page.goto(f"{site.http}/#/recordings/{made}")
    offer = page.get_by_role("region", name="Next step")
    expect(offer).to_contain_text("No method can score this recording yet")
    expect(offer.get_by_role("link", name="Train a monitor for")).to_have_count(0)
    site.ask("DELETE", f"/recordings/{made}")


def test_a_monitor_that_fits_is_preselected_though_a_newer_one_does_not(
    page: Page, site: RecordedSite, allowed_errors: list[str], attas: Monitor
) -> None:
    made = site.upload("fits.csv")
    site.confirm(made)
    newer = site.store.monitors.add(attas, "newer").id
    refused = f"**/recordings/{made}/manoeuvres?monitor={newer}"
    page.route(refused, lambda route: route.fulfill(json=[]))
    page.goto(f"{site.http}/#/recordings/{made}")
    expect(page.get_by_label("transport doublet", exact=True)).to_be_checked()
    expect(page.get_by_label("newer", exact=True)).not_to_be_checked()
    page.unroute(refused)
    site.store.monitors.delete(newer)
    site.ask("DELETE", f"/recordings/{made}")


def test_the_threshold_is_said_with_the_epsilon_that_it_keeps(
    scored: Page,
) -> None:
    words = """async (scoring) => (await import("/js/recordings/words.js")).alertRule(scoring)"""
    rule = scored.evaluate(words, {"epsilon": 0.1, "alert_above": 0.0495})
    assert re.search(r"above 0\.0495\b.*ε = 0\.1\b.*95 %", rule)
    shown = scored.evaluate(words, {"epsilon": 0.1, "alert_above": 0.1})
    assert re.search(r"above ε = 0\.1$", shown)
