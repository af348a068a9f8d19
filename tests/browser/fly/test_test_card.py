"""The test card beside the strips: its phase, what comes next, and the flown input."""

from typing import Any

import pytest
from playwright.sync_api import expect

from core.channels import KEYS
from core.monitor.assessment import Cause
from tests.browser.fly.test_fly_page import SAFE, Fly, site, stored
from tests.browser.fly.test_live import DT, Live
from tests.browser.strips import Open

__all__ = ["site", "stored"]
CARD: dict[str, Any] = {
    "inputs": [{"t": [0, 0.95, 1, 1.95, 2, 5], "y": [0.1, 0.1, -0.1, -0.1, 0, 0]}],
    "steps": [0, 1, 2],
    "length": 5,
}
BEGUN = [{"number": 1, "t": 10}, {"number": 2, "t": 30}]

PHASE = """async ([card, begun, frame]) => {
  const { phaseOf } = await import("/static/js/fly/test_card.js");
  const { phase, what, step, wait } = phaseOf(card, begun, frame);
  return [phase, what, step ?? null, wait === null ? null : Number(wait.toFixed(3))];
}"""


@pytest.mark.parametrize(
    ("t", "cause", "shown"),
    [
        (9.5, None, ["before", "step", 0, 0.5]),
        (10.4, None, ["input", "step", 1, 0.6]),
        (11.5, None, ["input", "step", 2, 0.5]),
        (12.0, None, ["response", "end", None, 3.0]),
        (15.5, None, ["after", "step", 0, 14.5]),
        (31.0, None, ["input", "step", 2, 1.0]),
        (36.0, None, ["after", "test end", 0, None]),
        (36.0, Cause.REST, ["after", "rest", 0, None]),
        (36.0, Cause.MOVING, ["after", "stillness", 0, None]),
        (36.0, Cause.READY, ["after", "step", 0, None]),
        (1.0, Cause.READY, ["before", "step", 0, 9.0]),
    ],
)
def test_the_phase_follows_the_first_input_and_names_what_comes_next(
    strips: Open, t: float, cause: str | None, shown: list[Any]
) -> None:
    frame = {"t": t, "cause": cause}
    assert strips().evaluate(PHASE, [CARD, BEGUN, frame]) == shown


FLOWN = """async ([values, dt, from, gap = -1]) => {
  const { createRingBuffer, FLAG } = await import("/static/js/charts/live/ring_buffer.js");
  const { flownOf } = await import("/static/js/fly/test_card.js");
  const ring = createRingBuffer({ series: 1, capacity: 4096 });
  values.forEach((value, k) => ring.push(k * dt + 10 * dt * (gap > 0 && k >= gap),
    [value ?? NaN], k === gap ? FLAG.gap : 0));
  const { y, peak, lasts, known } = flownOf(ring, 0, from, from + 4);
  return [Number.isNaN(peak) ? null : peak, lasts, known, y.findIndex(Number.isNaN)];
}"""


def test_peak_and_duration_are_those_of_the_flown_input(strips: Open) -> None:
    values = [0.0] * 20 + [0.5] * 20 + [-0.25] * 20 + [0.1] * 20
    peak, lasts, known, _ = strips().evaluate(FLOWN, [values, 0.05, 1.0])
    assert (peak, known) == (0.5, True)
    assert lasts == pytest.approx(39 * 0.05)


def test_a_gap_breaks_the_line_of_the_flown_input_and_does_not_last(strips: Open) -> None:
    values = [0.0] * 20 + [0.5] * 20 + [-0.25] * 20
    peak, lasts, known, broken = strips().evaluate(FLOWN, [values, 0.05, 1.0, 30])
    assert (peak, known, broken) == (0.5, True, 10)
    assert lasts == pytest.approx(38 * 0.05)


def test_a_missing_input_has_no_peak_and_a_lost_beginning_is_known_as_such(strips: Open) -> None:
    page = strips()
    assert page.evaluate(FLOWN, [[None] * 20, 0.05, 0.0])[0] is None
    assert page.evaluate(FLOWN, [[0.5] * 20, 0.05, -3.0])[2] is False


def test_a_simulated_flight_shows_phase_input_and_what_was_not_sent(fly: Fly) -> None:
    fly.watch(SAFE, ("pause", None), ("seek", 0.2))
    card = fly.page.locator(".test-card")
    expect(card.locator("[aria-current]")).to_have_text("before")
    expect(card.locator(".card-next")).to_contain_text("rudder to")
    expect(card.locator(".card-words")).to_contain_text("not flown yet")
    expect(card.locator("dd").first).to_have_text("not sent")
    fly.steer("seek", 4.0)
    expect(card.locator("[aria-current]")).to_have_text("response")
    expect(card.locator(".card-next")).to_contain_text("end of the manoeuvre in")
    expect(card.locator(".card-words")).to_contain_text("% ")
    assert card.locator(".card-flown").get_attribute("d")


def test_a_live_flight_waits_at_rest_and_shows_altitude_as_sent(live: Live) -> None:
    live.begin()
    card = live.page.locator(".test-card")
    expect(card.locator(".card-next")).to_have_text("no sample yet")

    def send(sequence: int, first: int, n: int, **more: Any) -> None:
        t = [DT * k for k in range(first, first + n)]
        body = {"sequence": sequence, "t": t, **{key: [0.0] * n for key in KEYS}, **more}
        live.ask("POST", f"/flights/{live.flight}/samples", body)

    send(1, 0, 4, altitude=[1500.0] * 4)
    expect(card).to_contain_text("1500 m")
    expect(card.locator("dd").first).to_have_text("not sent")
