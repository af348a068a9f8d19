"""Live flights on the page: started, waited for, marked, late, not durable, and their record."""

import errno
import json
import os
import re
import socket
from typing import Any

import pytest
from playwright.sync_api import expect

from app.store.flights import INTERRUPTED
from app.store.tables import flights
from app.telemetry import journal
from core.channels import KEYS
from tests.browser.chromium import wait_until
from tests.browser.conftest import CUT, Relay, Text
from tests.browser.fly.test_fly_page import EPSILON, SCROLL_SIZE, Fly, site, stored

__all__ = ["site", "stored"]
DT = 0.05
LATE = "samples come more than 0.5 s late"


def batch(sequence: int, first: int, n: int = 1, ny: float = 0.0) -> dict[str, Any]:
    """Samples at rest. ny: [g]."""
    t = [DT * k for k in range(first, first + n)]
    return {"sequence": sequence, "t": t, **{key: [0.0] * n for key in KEYS}, "Ny": [ny] * n}


class Live(Fly):
    """The page of a live flight, and what its source sends."""

    def begin(self, **source: Any) -> None:
        monitor = self.ask("GET", "/monitors")[0]["id"]
        order = {"source": {"kind": "live", **source}, "monitor": monitor, "epsilon": EPSILON}
        self.flight = self.ask("POST", "/flights", order)["id"]
        self.page.goto(f"{self.site.http}/#/fly/{self.flight}")
        self.connected()

    def send(self, sequence: int, first: int, n: int = 1, ny: float = 0.0) -> None:
        self.ask("POST", f"/flights/{self.flight}/samples", batch(sequence, first, n, ny))

    def figure(self, item: str) -> Any:
        return self.page.locator(f'.live-item[data-item="{item}"] .live-value')


def test_a_live_flight_takes_two_clicks_and_says_where_to_send_until_the_first_sample(
    live: Live,
) -> None:
    page = live.page
    page.goto(f"{live.site.http}/#/fly")
    page.get_by_role("radio", name="Live").check()
    page.get_by_role("button", name="Start the flight").click()
    live.connected()
    live.flight = page.url.rsplit("/", 1)[-1]
    address = page.locator(".source-address")
    expect(address).to_contain_text(f"/api/v1/flights/{live.flight}/uplink")
    expect(address).to_contain_text(f"forewarn push FILE --flight {live.flight}")
    expect(address.locator("tr", has_text="sideslip")).to_contain_text("rad")
    live.state_says("NO DATA")
    live.assert_no_number()
    for width, height in ((1280, 720), (1024, 768), (640, 360)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate(SCROLL_SIZE)[0] <= width
    command = address.locator("code", has_text="curl").inner_text()
    found = re.fullmatch(r"curl \S+(/api/v1/\S+) -d '(.*)'", command, re.DOTALL)
    assert found is not None
    page.request.post(live.site.http + found[1], data=found[2])
    expect(address).to_be_hidden()
    live.send(1, 1, 9)
    for sequence in (2, 3):
        sent = batch(sequence, 8 + sequence) | {"Nz": [1.0]}
        live.ask("POST", f"/flights/{live.flight}/samples", sent)
    expect(live.figure("unread")).to_have_text("Nz")
    told = page.locator(".event", has_text="no channel reads these names of the source: Nz")
    expect(told).to_have_count(1)
    expect(live.figure("rate")).to_have_text("20.0 Hz")
    expect(page.locator('[data-action="play"]')).to_be_hidden()
    page.get_by_role("button", name="Address").click()
    expect(address).to_be_visible()
    live.end()
    result = page.locator(".source-result")
    expect(result).to_contain_text("Live source: 12 samples used, of 4 batches")
    expect(result).to_contain_text("not read: Nz")
    expect(page.get_by_role("button", name="Replay as it was shown")).to_be_visible()


@pytest.mark.parametrize("silent", [False, True])
def test_a_link_that_is_cut_before_the_first_sample_is_stale_everywhere(
    own_live: Live, relay: Relay, silent: bool
) -> None:
    live, page = own_live, own_live.page
    is_cut = is_slow = False

    def to_page(text: Text, _: int) -> Text | None:
        waits = is_slow and json.loads(text)["type"] in ("frames", "status")
        return None if is_cut or waits else text

    routes = relay(to_page=to_page, is_cut=lambda: is_cut)
    live.begin()
    live.state_says("NO DATA")
    is_cut = True
    if not silent:
        routes[0].close(code=CUT)
    live.state_says("STALE")
    expect(page.locator(".mute")).to_have_attribute("data-callout", "stale")
    live.assert_no_number()
    expect(live.status("state")).to_have_text("◆ STALE")
    expect(page).to_have_title(re.compile("^◆ STALE – "))
    expect(page.locator(".source-address h2")).to_have_text(re.compile("^STALE"))
    is_cut = False
    live.connected()
    live.state_says("NO DATA")
    expect(page.locator(".source-address h2")).to_have_text(re.compile("^NO DATA"))
    live.send(0, 0, 5)
    clock = page.locator(".transport-time")
    expect(clock).to_contain_text("0.2")
    is_slow = True
    live.send(1, 10, ny=0.6)  # its alarm comes before its sample
    live.state_says("ALARM")
    expect(clock).to_contain_text("0.50 s")


def test_a_flight_whose_batches_are_all_refused_names_why_and_offers_no_replay(live: Live) -> None:
    live.begin()
    address = f"{live.site.http}/api/v1/flights/{live.flight}/samples"
    sent = batch(1, 0)
    del sent["Ny"]
    for _ in range(2):
        assert live.page.request.post(address, data=sent).status == 422
    expect(live.page.locator(".live-problem")).to_contain_text("REFUSED")
    expect(live.page.locator(".live-problem")).to_contain_text("Ny")
    live.end()
    result = live.page.locator(".source-result")
    expect(result).to_contain_text("refused messages: 2")
    expect(result).to_contain_text("Ny")
    expect(live.page.locator(".state-empty", has_text="every message")).to_be_visible()
    expect(live.page.get_by_role("button", name="Replay as it was shown")).to_be_hidden()


def test_a_key_begins_a_manoeuvre_which_is_listed_and_cannot_begin_twice(live: Live) -> None:
    live.begin()
    live.send(0, 0, 5, ny=0.3)
    expect(live.figure("phase")).to_contain_text("trim is measured")
    sensor = live.page.locator(".readout-sensor:visible")
    expect(sensor).to_have_count(0)
    button = live.page.get_by_role("button", name="Manoeuvre begins")
    expect(button).to_be_enabled()
    live.page.keyboard.press("g")
    expect(button).to_be_disabled()
    live.send(1, 5, 5, ny=0.3)
    live.event("manoeuvre 1 begins").wait_for()
    assert live.event_time("manoeuvre 1 begins") == pytest.approx(5 * DT)
    expect(live.figure("phase")).to_have_text("manoeuvre 1 in progress")
    words = "from trim, sensor 0.300 g"  # beside a value of zero
    expect(sensor).to_have_text([words])
    trim = "values count from trim: Ny 0.300 g, begun by hand"
    assert live.event_time(trim) == pytest.approx(5 * DT)
    live.end()
    expect(live.event(trim)).to_be_visible()
    expect(sensor).to_have_text([words])  # in the record too


def test_a_source_that_died_is_as_old_in_each_place_and_grows_older(own_live: Live) -> None:
    live = own_live
    live.begin(trim="none")
    live.send(0, 0, 40)
    places = {
        ".alarm-text": r"STALE at 1\.95 s: no sample comes; the newest is ([\d.]+) s old",
        ".gauge-reason": r"no sample comes; the newest is ([\d.]+) s old",
        ".link-lost": r"STALE\. No sample comes; the newest is ([\d.]+) s old",
        '[data-item="age"] .status-value': r"([\d.]+) s",
        ".readout-detail": r"last value, ([\d.]+) s old",
    }
    for place, words in places.items():
        expect(live.page.locator(place).first).to_have_text(re.compile(words))

    def ages() -> list[float]:
        texts = live.page.evaluate(
            "(places) => places.map((place) => document.querySelector(place).textContent)",
            list(places),
        )
        found = map(re.search, places.values(), texts)
        return [float(one[1]) for one in found if one is not None]

    before = ages()
    assert max(before) - min(before) < 0.6
    words = re.compile(r"the newest is [3-9][\d.]* s old")
    expect(live.page.locator(".alarm-text")).to_have_text(words)
    assert all(later > earlier for earlier, later in zip(before, ages(), strict=True))
    live.page.reload()
    expect(live.page.locator(".alarm-text")).to_have_text(words)
    live.page.goto(f"{live.site.http}/#/fly")
    expect(live.page.locator(f'[data-flight="{live.flight}"] .flight-stale')).to_have_text(words)


def test_a_datagram_that_is_no_batch_is_said_why_until_one_is(live: Live) -> None:
    """Nobody answers a datagram."""
    live.begin(udp=0)
    address, port = live.ask("GET", f"/flights/{live.flight}/samples")["udp"].split(":")
    warning = live.page.locator(".live-problem")
    with socket.socket(type=socket.SOCK_DGRAM) as source:
        source.sendto(b'{"t": 0, "air": {"beta_deg": 1}}', (address, int(port)))
        expect(warning).to_contain_text("REFUSED")
        expect(warning).to_contain_text("beta")
        source.sendto(json.dumps(batch(0, 0)).encode(), (address, int(port)))
        expect(warning).to_be_hidden()


def test_samples_that_are_not_durable_are_said_so_until_they_are(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    live.begin(udp=0)
    address, port = live.ask("GET", f"/flights/{live.flight}/samples")["udp"].split(":")
    warning = live.page.locator(".live-problem")
    with monkeypatch.context() as disk, socket.socket(type=socket.SOCK_DGRAM) as source:
        disk.setattr(journal.os, "pwrite", refuse)
        source.sendto(json.dumps(batch(0, 0)).encode(), (address, int(port)))
        expect(warning).to_contain_text("(No space left")
    expect(warning).to_be_hidden()
    expect(live.figure("batches")).to_have_text("1")


def test_a_step_of_the_source_s_clock_is_listed_and_counted(live: Live) -> None:
    live.begin(trim="none")
    live.send(0, 0, 20)
    live.send(1, 2000, 5)
    expect(live.figure("clock_steps")).to_have_text("1")
    live.event(r"clock stepped \(1 in all\)").wait_for()


def test_an_interrupted_flight_is_ended_on_its_page_which_says_by_whom_and_when(live: Live) -> None:
    live.begin(trim="none")
    live.send(0, 0, 5)
    live.end()
    notice = live.page.locator(".notice")
    expect(notice).to_contain_text(re.compile(r"was ended by local, 20[\d-]+ [\d:]+ UTC\."))
    wait_until(
        live.page,
        f"""fetch('/api/v1/flights/{live.flight}')
        .then((answer) => answer.json()).then(({{ recording }}) => recording !== null)""",
    )
    with live.site.store.engine.begin() as connection:
        values = {"status": INTERRUPTED, "recording_id": None}
        changed = flights.update().where(flights.c.id == live.flight).values(**values)
        connection.execute(changed)
    live.page.reload()
    expect(notice).to_contain_text("was interrupted")
    live.page.get_by_role("button", name="End flight").click()
    live.page.get_by_role("dialog").get_by_role("button", name="End flight").click()
    expect(notice).to_contain_text("was ended by local")


def test_late_samples_and_a_server_that_was_started_again_are_told(
    own_live: Live, relay: Relay
) -> None:
    live = own_live

    def altered(text: Text, _: int) -> str:
        message = json.loads(text)
        if message["type"] == "state":
            message |= {"state": "stale", "reason": LATE}
        if message["type"] in ("hello", "live"):
            message["live"]["resumed"] = len(routes) - 1
        if message["type"] == "hello":
            message["head"] -= 3 * (len(routes) - 1)
        return json.dumps(message)

    routes = relay(to_page=altered)
    live.begin(trim="none")
    live.send(0, 0, 40)
    expect(live.page.locator(".transport-time")).to_have_text("1.95 s")
    expect(live.page.locator(".gauge-reason")).to_contain_text(LATE)
    live.assert_no_number()
    routes[-1].close(code=CUT)
    live.event("server restarted").wait_for()
    live.event("3 samples shown, not stored").wait_for()
    expect(live.figure("resumed")).to_have_text("1")


def test_the_record_says_when_the_display_was_stale(own_live: Live) -> None:
    live = own_live
    live.begin(trim="none")
    live.send(0, 0, 40)
    expect(live.page.locator(".alarm-text")).to_contain_text(re.compile(r"newest is [1-9]"))
    live.send(1, 40)  # as after an outage: first a sample that is seconds late, then all others
    live.event("stale").wait_for()
    live.send(2, 41, 400)
    live.end()
    live.page.reload()
    live.event(r"stale: .*, until \d+\.\d\d s").wait_for()
    result = live.page.locator(".source-result")
    expect(result).to_contain_text(re.compile(r"stale, samples late: 1\.95 s to \d+\.\d\d s"))
