"""A scored recording: verdicts, notes, what leads out of the page, comparisons."""

import re
from typing import Any

from playwright.sync_api import Page, expect

from app.assessment.outcome import OUTCOMES
from core.monitor import Monitor
from tests.browser.recorded_site import RecordedSite
from tests.browser.recordings.scored_chart import drawn, pixels, press, redrawn

SCENE = ["THREE.Clock", "GPU stall due to ReadPixels"]


def test_every_verdict_has_a_word_and_says_what_is_promised(
    scored: Page, scoring: dict[str, Any]
) -> None:
    words = [
        "✓ QUIET",
        re.compile(r"^▲ LIMIT EXCEEDED, warned \d\.\d\d s before the limit$"),
        re.compile("INVALID$"),
    ]
    expect(scored.locator(".scored-summary .chip")).to_have_text(words)
    lane = scored.locator(".lane-item")
    expect(lane).to_have_count(3)
    for k, word in enumerate(("QUIET", "LIMIT EXCEEDED, warned", ".*INVALID")):
        expect(lane.nth(k)).to_have_attribute("title", re.compile(f"^manoeuvre {k + 1}: {word}"))
    cut = """lanes => lanes.flatMap((lane) => {
        const whole = lane.querySelector(".lane-words").getBoundingClientRect();
        const parts = [...lane.querySelectorAll(".lane-part")];
        const seen = parts.filter((part) => part.getBoundingClientRect().top < whole.bottom);
        return seen.filter((part) => part.scrollWidth > part.clientWidth);
    }).length"""
    assert lane.evaluate_all(cut) == 0
    verdicts = scored.locator(".verdict")
    for k, manoeuvre in enumerate(scoring["manoeuvres"]):
        expect(verdicts.nth(k)).to_contain_text(manoeuvre["guarantee"])
        checks = verdicts.nth(k).locator(".checks li")
        expect(checks).to_have_count(len(manoeuvre["validity"]["checks"]))
    share = f"none, at {100 * scoring['manoeuvres'][0]['amplitude']:.0f} % of the planned amplitude"
    expect(verdicts.nth(0)).to_contain_text(share)
    promised = f"{scoring['manoeuvres'][1]['lead']:.2f} s, at least 0.25 s"
    expect(verdicts.nth(1)).to_contain_text(promised)
    expect(verdicts.nth(2)).to_contain_text("Guarantee withdrawn")
    for label in ("First alert", "Warning lead time", "Peak risk"):
        expect(verdicts.nth(2).locator(f'[data-label="{label}"]')).to_have_text("INVALID")
    expect(scored.locator(".scored-summary")).to_contain_text("channels are deviations from trim")
    expect(verdicts.nth(2).locator('[data-ok="false"]')).to_contain_text(
        ["✕ manoeuvre", "✕ observations"]
    )


def test_sensors_are_compared_and_remarked_on(scored: Page, scoring: dict[str, Any]) -> None:
    panel = scored.get_by_role("region", name="Data compatibility")
    expect(panel).to_contain_text("delay 0.05 s")
    table = panel.locator("tbody")
    checks = scoring["quality"]["compatibility"]
    expect(table).to_have_count(len(checks))
    for k, check in enumerate(checks):
        expect(table.nth(k)).to_contain_text(check["title"])
        expect(table.nth(k)).to_contain_text(check["remarks"] or [check["unchecked"]])
    scale = checks[0]["scale"]
    said = f"{scale['value']:.3g} ({scale['low']:.3g} to {scale['high']:.3g})"
    expect(table.first.locator('[data-label="Scale"]')).to_have_text(said)


def test_an_exceedance_outside_every_manoeuvre_is_told(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    path = f"/recordings/{recording}/scorings/{scoring['id']}"
    exceedance = {"t": 0.2, "channel": "Ny", "value": -0.21}
    words = OUTCOMES["unseen"]._asdict()
    unseen = {"outcome": "unseen", "verdict": words, "outcome_words": words}
    manoeuvres = [scoring["manoeuvres"][0] | unseen]
    told = {**scoring, "outside_exceedances": [exceedance], "manoeuvres": manoeuvres}
    page.route(f"**/api/v1{path}", lambda route: route.fulfill(json=told))
    page.goto(f"{site.http}/#{path.replace('/scorings/', '?scoring=')}")
    drawn(page)
    line = page.locator(".outside-line")
    expect(line).to_contain_text("exceeds its limit outside every manoeuvre: −0.210 g at 0.20 s")
    expect(page.locator(".event-list .event")).to_contain_text(["outside every manoeuvre"])
    expect(page.locator(".verdict .chip").first).to_have_text("◇ DATA MISSING")
    expect(page.locator('.verdict [data-label="First exceedance"]')).to_have_text("unknown")
    expect(page.locator('.verdict .chip[data-level="ok"]')).to_have_count(0)
    press(page, "n")
    assert "cursor 0." in page.locator(".strip-cursors").inner_text()


def test_where_only_a_trim_is_unknown_no_other_monitor_is_offered(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    path = f"/recordings/{recording}/scorings/{scoring['id']}"
    exceedance = {"t": 0.2, "channel": "Ny", "value": -0.21, "doubt": "trim unknown"}
    known, words = scoring["manoeuvres"][0], OUTCOMES["invalid"]._asdict()
    checks = [{"name": "trim", "ok": False, "text": "trim of Ny unknown"}]
    invalid = known | {
        "outcome": "invalid",
        "verdict": words,
        "outcome_words": words,
        "exceedance": None,
        "recorded_exceedance": None,
        "trim": [None] * len(known["trim"]),
        "validity": known["validity"] | {"valid": False, "checks": checks},
    }
    told = {**scoring, "outside_exceedances": [exceedance], "manoeuvres": [invalid]}
    page.route(f"**/api/v1{path}", lambda route: route.fulfill(json=told))
    page.goto(f"{site.http}/#{path.replace('/scorings/', '?scoring=')}")
    drawn(page)
    expect(page.locator(".outside-line")).to_contain_text("at 0.20 s, trim unknown")
    expect(page.get_by_text("LIMIT EXCEEDED OUTSIDE")).to_have_attribute("data-level", "alert")
    exceeded = page.locator('.verdict [data-label="First exceedance"]')
    expect(exceeded).to_have_text("unknown, trim unknown")
    expect(page.get_by_text("trained for another test")).to_have_count(0)


def test_a_scoring_by_an_earlier_mapping_is_marked(
    page: Page, site: RecordedSite, scoring: dict[str, Any]
) -> None:
    other = site.upload("turned.csv")
    site.confirm(other)
    made = site.score(other, epsilon=0.1)
    mapping = site.ask("GET", f"/recordings/{other}")["mapping"]
    mapping["channels"]["beta"]["sign"] *= -1
    body = {"mapping": mapping, "remember": False}
    site.ask("PUT", f"/recordings/{other}/mapping", json=body)
    page.goto(f"{site.http}/#/recordings/{other}")
    chip = page.locator(".chip", has_text="earlier mapping")
    expect(chip).to_have_attribute("title", re.compile("of sideslip"))
    both = f"{made['id']},{scoring['recording']}:{scoring['id']}"
    page.goto(f"{site.http}/#/recordings/{other}?compare={both}")
    expect(page.locator(".compare-table thead")).to_contain_text("earlier mapping")
    expect(chip).to_have_count(1)


def test_notes_and_markers_are_set_changed_and_deleted(
    scored: Page, site: RecordedSite, recording: str
) -> None:
    expect(scored.get_by_role("button", name="Add note")).to_be_disabled()
    text = scored.get_by_role("textbox", name="text of the note")
    press(scored, "n", "m")
    notes = scored.locator(".note")
    expect(notes).to_contain_text(["marker 1"])
    press(scored, "a", "n", "b")
    text.fill("gust from the left")
    scored.get_by_role("button", name="Add note").click()
    expect(notes).to_have_count(2)
    expect(scored.locator(".lane-item", has_text="gust")).to_be_visible()
    scored.get_by_role("button", name="Edit: gust from the left").click()
    editor = notes.locator("input")
    editor.fill("gust from the right")
    editor.press("Enter")
    expect(notes).to_contain_text(["marker 1", "gust from the right"])
    markers = site.ask("GET", f"/recordings/{recording}/markers")
    assert [(marker["kind"], marker["text"]) for marker in markers] == [
        ("marker", "marker 1"),
        ("note", "gust from the right"),
    ]
    assert markers[1]["end"] > markers[1]["t"]
    for name in ("marker 1", "gust from the right"):
        scored.get_by_role("button", name=f"Delete: {name}").click()
    expect(notes).to_have_count(0)


def test_report_and_exports_are_links_that_work(scored: Page, site: RecordedSite) -> None:
    links = {
        name: scored.get_by_role("link", name=name, exact=True).get_attribute("href")
        for name in ("Report", "CSV", "Parquet", "MAT")
    }
    for name, address in links.items():
        answer = scored.request.get(f"{site.http}{address}")
        assert answer.ok, name
        assert len(answer.body()) > 1000


def test_replay_flies_the_recording(
    scored: Page, recording: str, site: RecordedSite, allowed_errors: list[str]
) -> None:
    allowed_errors += SCENE
    scored.evaluate("localStorage.setItem('forewarn.scene', 'hidden')")
    scored.get_by_role("button", name="Replay").click()
    scored.locator('[data-flight="open"]').wait_for()
    flights = site.ask("GET", "/flights")
    assert flights[0]["source"]["recording"] == recording
    site.ask("POST", f"/flights/{flights[0]['id']}/end")


def test_scorings_of_one_recording_are_compared_sample_by_sample(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    second = site.score(recording, epsilon=0.4)
    page.goto(f"{site.http}/#/recordings/{recording}?compare={scoring['id']},{second['id']}")
    path = f"/recordings/{recording}/scorings/{scoring['id']}/comparison"
    found = site.ask("GET", path, params={"scoring": second["id"]})
    counts = [f"{found[name]:,}" for name in ("n_first", "n_second")]
    cells = page.locator(".comparison tbody tr", has_text="Samples assessed").locator("td")
    expect(cells).to_have_text(counts)
    t = f"at {found['largest']['t']:.2f} s"
    largest = page.locator(".comparison tbody tr", has_text="Largest difference")
    expect(largest.locator("td").last).to_contain_text(t)
    for width in (1024, 1440, 1920):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_scorings_are_compared_and_laid_over_each_other(
    page: Page, site: RecordedSite, recording: str, scoring: dict[str, Any]
) -> None:
    other = site.upload("second recorder.csv")
    site.confirm(other)
    theirs = site.score(other, epsilon=0.3)
    page.goto(f"{site.http}/#/recordings/{recording}?compare={scoring['id']}")
    expect(page.locator(".compare-table thead th")).to_have_count(2)
    page.get_by_label("Add a scoring of").select_option(other)
    expect(page.get_by_role("button", name="Add")).to_be_enabled()
    page.get_by_role("button", name="Add").click()
    page.wait_for_url(f"**compare={scoring['id']},{other}:{theirs['id']}")
    expect(page.locator(".compare-table thead th")).to_have_count(3)
    for head in page.locator(".compare-head").all():
        expect(head).to_contain_text("ATTAS")
        expect(head).to_contain_text("doublet")
    expect(page.locator(".compare-table tbody tr")).to_have_count(3)
    drawn(page)
    expect(page.locator(".overlay-key")).to_contain_text("t = 0 at")
    redrawn(page)
    assert pixels(page, "Ny", "trace") > 100
    assert pixels(page, "Ny", "forecast") > 100
    page.get_by_label("start of the second scoring").select_option("1")
    expect(page.locator(".lane-item", has_text="B manoeuvre 2")).to_be_visible()
    page.evaluate("document.querySelector('.compare-table').dataset.old = ''")
    page.locator("#units").dblclick()
    expect(page.locator(".compare-table[data-old]")).to_have_count(0)  # redrawn
    expect(page.locator('.strip[data-key="p"] .readout-unit').first).to_have_text("rad/s")
    expect(page.get_by_label("start of the second scoring")).to_have_value("1")
    page.locator("#units").click()
    page.get_by_role("button", name="Remove B").click()
    expect(page.locator(".compare-table thead th")).to_have_count(2)


def test_manoeuvres_of_one_recording_are_matched_by_time_and_of_others_by_order(
    scored: Page,
) -> None:
    rows = scored.evaluate("""async () => {
        const { rowsOf } = await import("/js/recordings/compare/table.js");
        const scoring = (recording, ...times) =>
            ({ recording, manoeuvres: times.map(([start, end]) => ({ start, end })) });
        return rowsOf([
            scoring("a", [0, 10], [20, 30]),
            scoring("a", [21, 29], [40, 50]),
            scoring("b", [100, 110]),
        ]);
    }""")
    assert rows == [[0, -1, 0], [1, 0, -1], [-1, 1, -1]]


def test_a_recording_is_replayed_with_a_further_monitor_that_has_scored_it(
    page: Page, recording: str, site: RecordedSite, scoring: dict[str, Any], attas: Monitor
) -> None:
    second = site.store.monitors.add(attas, "second look").id
    own = site.ask("GET", f"/monitors/{second}")["epsilon"]
    site.score(recording, monitor=second, epsilon=own)
    page.goto(f"{site.http}/#/recordings/{recording}?scoring={scoring['id']}")
    page.evaluate("localStorage.setItem('forewarn.scene', 'hidden')")
    page.get_by_text("Further monitors, for display").click()
    page.get_by_label("second look").check()
    page.get_by_role("button", name="Replay").click()
    page.locator('[data-flight="open"]').wait_for()
    flight = site.ask("GET", "/flights")[0]
    assert [one["name"] for one in flight["monitors"]][1:] == ["second look"]
    expect(page.locator(".gauge-panel")).to_contain_text("second look")
    site.ask("POST", f"/flights/{flight['id']}/end")
