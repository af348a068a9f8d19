"""A scoring under a limit set on its page: limits where they held, a word where nothing is said."""

from playwright.sync_api import Page

from tests.browser.strips import Open

HELD = """
const { eventsOf, limitsInForceOf, manoeuvresOf } = await import(
  "/static/js/recordings/scoring/events.js"
);
const { bandsOf } = await import("/static/js/charts/recorded/cells.js");
const about = { name: "envelope", version: 1, case: "all" };
const held = [
  { ...about, start: 0, end: 4, limits: { Ny: 0.5 }, reason: "" },
  { ...about, start: 4, end: 6, limits: { Ny: 0.4 }, reason: "not applicable: ..." },
  { ...about, start: 6, end: 8, limits: null, reason: "limits unknown: ..." },
  { ...about, start: 8, end: 9, limits: { Ny: 0.5 }, reason: "" },
];
const manoeuvre = { name: "doublet", start: 0, end: 9, alerts: [], exceedance: null, peak_t: null,
  validity: { valid: false }, withdrawn_t: null, limits_in_force: held };
const channels = [{ key: "Ny", symbol: "N_y", unit: "g", display_unit: "g", display_factor: 1,
  display_decimals: 3 }];
const scoring = { manoeuvres: [manoeuvre], outside_exceedances: [], channels, alert_above: 0.1,
  limits_in_force: held };
const set = { n: 0, step: 1, x0: [], state: [], alert: [], keys: () => [], series: () => ({}) };
const bands = bandsOf({ set, from: 0, n: 0 }, manoeuvresOf(scoring), (t) => t);
return [
  bands.filter(({ kind }) => kind === "withdrawn").map(({ x0, x1, word }) => [x0, x1, word]),
  limitsInForceOf(scoring, 1).map(({ start, limits }) => [start, limits?.Ny ?? null]),
  eventsOf(scoring).map(({ t, text }) => [t, text]),
];
"""


def test_bands_limits_and_events_of_a_limit_set(strips: Open) -> None:
    page: Page = strips()
    bands, held, events = page.evaluate(f"async () => {{ {HELD} }}")
    assert bands == [[4, 6, "NOT APPLICABLE"], [6, 8, "LIMITS UNKNOWN"]]
    assert held == [[-1, 0.5], [3, 0.4], [5, None], [7, 0.5]]
    assert [4, "limits in force: all (envelope version 1)"] in events
    assert [6, "limits unknown (envelope version 1)"] in events
    assert not any("INVALID" in text for _, text in events)


def test_what_was_shown_in_flight_is_not_marked_withdrawn(strips: Open) -> None:
    """A check of the whole manoeuvre failed; scorings of earlier versions do not know when."""
    code = """async () => {
      const { withdrawnAt } = await import("/static/js/recordings/scoring/events.js");
      const manoeuvre = { start: 3, validity: { valid: false } };
      return [{ withdrawn_t: null }, { withdrawn_t: 4 }, {}].map((when) =>
        withdrawnAt({ ...manoeuvre, ...when }));
    }"""
    assert strips().evaluate(code) == [None, 4, 3]
