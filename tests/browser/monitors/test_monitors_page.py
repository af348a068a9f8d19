"""Monitors and Datasets in a real Chromium, against the real server."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import httpx2
import pytest
from playwright.sync_api import Page, Route, expect

from app.catalog import catalog
from app.store.store import Store
from core.monitor import train
from core.monitor.calibration import Guarantee, failures_needed
from tests.browser.site import open_site
from tests.support.glb_file import glb

SMALL = {"n_unsafe": 40, "seed": 5}
N_TEST = 300
DRAWN = 40
SLOW = 60_000
"""[ms] A first training compiles kernels."""

PAIR = ("predictor", "score")


@dataclass(frozen=True)
class Site:
    """A server with one trained monitor."""

    http: str
    monitor: str
    dataset: str
    store: Store

    def get(self, path: str) -> Any:
        return httpx2.get(f"{self.http}/api/v1{path}").raise_for_status().json()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with open_site(tmp_path_factory.mktemp("trained")) as server:
        origin = server.http
        order = {"dataset": SMALL, "n_test": N_TEST, "name": "card 7", "guarantee": "average"}
        job = httpx2.post(f"{origin}/api/v1/monitors", json=order).raise_for_status()
        stream = httpx2.get(f"{origin}{job.headers['location']}/events", timeout=60)
        assert '"done"' in stream.text.replace(" ", "")
        made = httpx2.get(f"{origin}{job.headers['location']}").json()["result"]
        yield Site(origin, made["monitor"], made["dataset"], server.store)


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def field(page: Page, path: str):
    return page.locator(f'[name="{path}"]')


# Nothing there yet


@pytest.mark.parametrize(
    ("view", "says", "leads_to"),
    [
        ("monitors", "No monitor yet", "#/monitors/new"),
        ("datasets", "No dataset yet", "#/datasets/new"),
        ("campaigns", "No campaign yet", "#/campaigns/new"),
    ],
)
def test_an_empty_list_says_what_to_do_next(page: Page, fresh: Site, view, says, leads_to) -> None:
    page.goto(f"{fresh.http}/#/{view}")
    state = page.locator(".state-empty")
    expect(state).to_contain_text(says)
    expect(state.locator(".button-primary")).to_have_attribute("href", leads_to)


# Training through the form


def test_a_monitor_is_trained_through_the_form_and_shown(page: Page, fresh: Site) -> None:
    page.goto(f"{fresh.http}/#/monitors/new")
    field(page, "dataset.n_unsafe").fill("30")
    field(page, "monitor.epsilon").fill("0.2")
    page.get_by_label("name of the monitor").fill("first card")
    page.get_by_text("Predictor, score, groups, promise, calibration, test flights").click()
    field(page, "monitor.n_test").fill("200")
    field(page, "monitor.guarantee").select_option("average")
    page.get_by_role("button", name="Train", exact=True).click()
    expect(page.locator(".job .progress")).to_be_visible()
    expect(page.get_by_role("heading", level=1)).to_have_text("first card", timeout=SLOW)
    expect(page).to_have_url(re.compile(r"#/monitors/[0-9a-f]+$"))
    facts = page.locator(".facts")
    for words in ("F-16", "rudder doublet", "0.25 s", "30 failures", "0.0323", "|Ny| < 0.5 g"):
        expect(facts).to_contain_text(words)
    expect(page.locator("figure svg.plot")).to_have_count(5)
    expect(page.get_by_text("Failures that an alert prevents")).to_be_visible()
    expect(page.get_by_role("link", name="Certificate")).to_be_visible()
    page.locator("summary", has_text="All results on fresh flights").click()
    certificate = page.frame_locator("iframe.certificate")
    expect(certificate.get_by_role("row", name=re.compile("^input in the opp"))).to_be_visible()
    expect(page.locator(".epsilon-reading")).to_have_text("ε = 0.2")
    page.goto(f"{fresh.http}/#/monitors")
    cells = page.locator("tbody tr", has_text="first card").locator("td")
    (listed,) = httpx2.get(f"{fresh.http}/api/v1/monitors").json()
    shares = [percent(listed[key]["count"] / listed[key]["total"]) for key in ("missed", "quiet")]
    expect(cells).to_contain_text([*shares, "≤ 2.0 % INVALID"])


def test_training_can_be_cancelled_and_the_form_is_as_it_was(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "dataset.maneuver.amplitude_deg").fill("0.5")
    page.get_by_text("Sampling, noise, imperfections, seed, budget").click()
    field(page, "dataset.max_rollouts").fill("1000000000")
    page.get_by_role("button", name="Train", exact=True).click()
    expect(page.locator(".job")).to_have_attribute("data-status", "running")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".job .error")).to_contain_text("Cancelled", timeout=SLOW)
    page.get_by_role("button", name="Back").click()
    expect(field(page, "dataset.maneuver.amplitude_deg")).to_have_value("0.5")


def test_a_test_that_never_fails_says_what_to_change(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "dataset.maneuver.amplitude_deg").fill("0.1")
    page.get_by_text("Sampling, noise, imperfections, seed, budget").click()
    field(page, "dataset.max_rollouts").fill("2000")
    page.get_by_role("button", name="Train", exact=True).click()
    error = page.locator(".job .error")
    expect(error).to_contain_text("It failed: 0 of", timeout=SLOW)
    expect(error).to_contain_text("At an amplitude of 11.1")


def test_another_aircraft_brings_its_usual_test(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "dataset.aircraft.kind").select_option("attas_id_16kft")
    expect(field(page, "dataset.control_law.kind")).to_have_value("attas_damper")
    expect(field(page, "dataset.maneuver.amplitude_deg")).to_have_value("6.4")
    expect(field(page, "dataset.limits.Ny")).to_have_value("0.2")
    field(page, "dataset.limits.Ny").fill("0.3")
    field(page, "dataset.limits.Ny").blur()
    field(page, "dataset.aircraft.kind").select_option("dc8_15k_m0p44")
    expect(field(page, "dataset.control_law.kind")).to_have_value("none")
    expect(field(page, "dataset.limits.Ny")).to_have_value("0.3")
    flown = {"maneuver.amplitude_jitter": "0.15", "imperfections.gain": "0.02", "noise.Ny": "0.003"}
    for path, value in flown.items():
        expect(field(page, f"dataset.{path}")).to_have_value(value)
    page.get_by_text("Sampling, noise, imperfections, seed, budget").click()
    page.get_by_role("button", name="None", exact=True).click()
    for path in flown:
        expect(field(page, f"dataset.{path}")).to_have_value("0")
    expect(field(page, "dataset.imperfections.turbulence")).to_have_value("none")
    expect(field(page, "dataset.maneuver.amplitude_deg")).to_have_value("5")


def test_an_aircraft_of_jsbsim_brings_its_condition(page: Page, site: Site) -> None:
    pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")
    page.goto(f"{site.http}/#/monitors/new")
    page.get_by_label("JSBSim").check()
    options = field(page, "dataset.aircraft.model").locator("option")
    expect(options.filter(has_text="no known trim")).to_have_count(27)
    field(page, "dataset.aircraft.model").select_option("737")
    expect(field(page, "dataset.condition.mach")).to_have_value("0.6")
    expect(field(page, "dataset.condition.altitude_m")).to_have_value("5000")
    field(page, "dataset.condition.mach").fill("0.55")
    field(page, "dataset.condition.mach").blur()
    field(page, "dataset.aircraft.model").select_option("c182")
    expect(field(page, "dataset.condition.mach")).to_have_value("0.55")
    expect(field(page, "dataset.condition.altitude_m")).to_have_value("1500")


def test_a_capture_brings_its_pilot(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    pilot = field(page, "dataset.pilot.kind")
    field(page, "dataset.maneuver.kind").select_option("bank_capture")
    expect(pilot).to_have_value("crossover")
    for part in ("maneuver", "pilot"):
        axes = field(page, f"dataset.{part}.axis").locator("option")
        expect(axes).to_have_text(["bank angle", "sideslip", "heading"])
    field(page, "dataset.maneuver.kind").select_option("rudder_doublet")
    expect(pilot).to_have_value("open_loop")
    surfaces = field(page, "dataset.maneuver.surface").locator("option")
    expect(surfaces).to_have_text(["aileron", "rudder"])
    page.get_by_role("radio", name="Nonlinear").check()
    expect(surfaces).to_have_text(["aileron", "rudder", "elevator"])


def test_limits_are_disabled_while_a_margin_labels(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/datasets/new")
    limits, margin = field(page, "dataset.limits.Ny"), field(page, "dataset.margins.phase_deg")
    note = page.get_by_text("these limits do not count")
    expect(limits).to_be_enabled()
    expect(note).to_be_hidden()
    margin.evaluate("element => { element.closest('details').open = true; }")
    margin.fill("40")
    expect(limits).to_be_disabled()
    expect(note).to_be_visible()
    margin.fill("")
    expect(limits).to_be_enabled()
    expect(note).to_be_hidden()


def test_an_aircraft_of_jsbsim_is_simulated_by_the_form(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    pytest.importorskip("jsbsim", reason="JSBSim is not installed: the extra jsbsim")
    page.goto(f"{site.http}/#/datasets/new")
    page.get_by_role("radio", name="JSBSim").check()
    expect(field(page, "dataset.aircraft.model")).to_have_value("c172p")
    expect(field(page, "dataset.control_law.kind")).to_have_count(0)
    expect(field(page, "dataset.pilot.kind")).to_have_count(0)
    field(page, "dataset.maneuver.kind").select_option("wind_up_turn")
    expect(field(page, "dataset.condition.load_factor")).to_have_value("1.4")
    field(page, "dataset.maneuver.kind").select_option("rudder_doublet")
    expect(field(page, "dataset.limits.beta_deg")).to_have_value("5")
    expect(field(page, "dataset.limits.Nz_high")).to_have_value("")
    field(page, "dataset.maneuver.kind").select_option("pitch_doublet")
    field(page, "dataset.maneuver.amplitude_deg").fill("-7")
    field(page, "dataset.aircraft.model").select_option("737")
    field(page, "dataset.condition.mach").fill("0.1")
    field(page, "dataset.n_unsafe").fill("4")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(page.get_by_role("form")).to_contain_text("no trim at 32.05 m/s (Mach 0.1) and 5000 m")
    field(page, "dataset.aircraft.model").select_option("c172p")
    field(page, "dataset.condition.mach").fill("0.165")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("JSBSim c172p", timeout=SLOW)
    expect(page.locator("main")).to_contain_text("Mach 0.165")
    dataset = page.url.rpartition("/")[2]
    page.goto("about:blank")
    site.store.datasets.delete(dataset)


def test_without_jsbsim_the_form_names_the_extra(page: Page, site: Site) -> None:
    def without(route: Route) -> None:
        published = route.fetch().json()
        published["recipes"]["jsbsim"]["needs"] = "forewarn[jsbsim]"
        route.fulfill(json=published)

    page.route("**/api/v1/catalog", without)
    page.goto(f"{site.http}/#/datasets/new")
    page.reload()
    expect(page.get_by_role("radio", name="JSBSim")).to_be_disabled()
    expect(page.get_by_role("form")).to_contain_text("pip install 'forewarn[jsbsim]'")
    page.unroute("**/api/v1/catalog")
    page.reload()


def test_an_amplitude_is_suggested_for_another_limit(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "dataset.limits.Ny").fill("0.25")
    page.get_by_role("button", name="Suggest amplitude").click()
    expect(page.locator(".suggestion")).to_contain_text("25 % of 400 pilot rollouts", timeout=SLOW)
    amplitude = float(field(page, "dataset.maneuver.amplitude_deg").input_value())
    assert 4.5 < amplitude < 6
    allowed_errors.append("422")
    field(page, "dataset.limits.Ny").fill("29")
    page.get_by_role("button", name="Suggest amplitude").click()
    expect(page.locator(".suggestion")).to_contain_text("even at 45 deg")


def test_numbers_that_are_missing_are_said_beside_their_fields(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    amplitude = field(page, "dataset.maneuver.amplitude_deg")
    amplitude.fill("")
    page.get_by_role("button", name="Train", exact=True).click()
    expect(amplitude).to_have_attribute("aria-invalid", "true")
    expect(amplitude).to_be_focused()
    beside = page.locator('.field[data-path="dataset.maneuver.amplitude_deg"] .error')
    expect(beside).to_have_text("Enter a number.")
    expect(page.locator(".job")).to_have_count(0)


def test_the_servers_refusal_is_shown_where_it_belongs(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    page.goto(f"{site.http}/#/monitors/new")
    duration = field(page, "dataset.maneuver.duration_s")
    page.locator("summary", has_text="length of the trim segment").click()
    duration.fill("-1")
    page.get_by_role("button", name="Train", exact=True).click()
    error = page.locator('[data-path="dataset.maneuver.duration_s"] .error')
    expect(error).to_have_text(re.compile("^Length of the rollout is −1.0; give a finite"))
    expect(duration).to_be_focused()
    expect(page.get_by_role("button", name="Train", exact=True)).to_be_enabled()


def test_an_epsilon_that_the_failures_cannot_serve_is_said_at_once(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "monitor.epsilon").fill("0.01")
    served_words = page.locator(".served")
    expect(served_words).to_contain_text("enough for ε ≥ 0.00597")
    field(page, "dataset.n_unsafe").fill("99")
    expect(served_words).to_contain_text("needs at least 299 unsafe rollouts, and 99")
    expect(page.locator("#method option").first).to_contain_text("in any manoeuvre (recommended)")


READ_BACK = """async ([catalog, cases]) => {
    const { createFields } = await import("/js/forms/form.js");
    return cases.map(({ schema, initial }) => {
        const fields = createFields(schema, initial, { catalog, path: "x" });
        const holder = document.body.appendChild(document.createElement("form"));
        holder.append(...fields.keys.map(fields.element));
        const noise = holder.querySelectorAll("[data-path*='.noise.'] .unit");
        const units = [...noise].map((unit) => unit.textContent);
        const read = [fields.check(), fields.read(), units];
        holder.remove();
        return read;
    });
}"""


def members() -> list[tuple[str, str]]:
    families = catalog()["families"].items()
    return [(family, kind) for family, members in families for kind in members["entries"]]


def test_an_untouched_form_asks_for_the_defaults_of_every_recipe_and_member(
    page: Page, site: Site
) -> None:
    page.goto(f"{site.http}/#/monitors")
    known = site.get("/catalog")
    cases = list(known["recipes"].values())
    cases += [known["families"][family]["entries"][kind] for family, kind in members()]
    given = [{"schema": case["schema"], "initial": case["default"]} for case in cases]
    *read, units = zip(*page.evaluate(READ_BACK, [known, given]), strict=True)
    noise = {unit.strip() for each in units for unit in each}
    assert noise == {"[deg]", "[deg/s]", "[g]", "[m/s]", "[Pa]"}
    read = [list(each) for each in zip(*read, strict=True)]
    for recipe in (recipe for _, each in read for recipe in (each, each.get("dataset", {}))):
        if recipe.get("pilot") == {"kind": "open_loop"}:
            del recipe["pilot"]  # the usual one has no key in the plain form
        if set((recipe.get("margins") or {"": 1}).values()) == {None}:
            del recipe["margins"]
    assert read == [[True, case["default"]] for case in cases]


def test_an_own_model_is_pasted_as_json(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    field(page, "dataset.aircraft.kind").select_option("matrices")
    expect(field(page, "dataset.control_law.kind")).to_have_value("none")
    box = page.get_by_label("own model as JSON")
    box.fill('{"A": [[1]]')
    page.get_by_role("button", name="Use this model").click()
    expect(page.locator(".model-input .error")).to_contain_text("Not JSON")
    box.fill('{"A": [[-1]], "B": [[1, 2]], "C": [[1]], "D": [[0]], "uncertainty": {"spread": 0.2}}')
    page.get_by_role("button", name="Use this model").click()
    expect(field(page, "dataset.aircraft.b")).to_have_value("[[1,2]]")
    expect(page.get_by_label("one number for all")).to_have_value("0.2")


def test_a_job_that_was_lost_is_told_in_the_list(page: Page, site: Site) -> None:
    job = site.store.jobs.add("monitor", {"name": "card 8"})
    site.store.jobs.update(job, status="interrupted", message="training")
    page.goto(f"{site.http}/#/monitors")
    page.get_by_text("that did not finish").click()
    expect(page.locator("main")).to_contain_text(
        "Training “card 8”: interrupted, the server stopped"
    )


# A monitor's page


def test_the_slider_tells_what_the_stored_evaluation_says(page: Page, site: Site) -> None:
    evaluation = site.get(f"/monitors/{site.monitor}/evaluation")
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    slider = page.locator("#epsilon")
    expect(page.locator(".epsilon-reading")).to_have_text("ε = 0.1")
    for key, expected in (("Home", 0), ("End", -1)):
        slider.press(key)
        curves = {name: values[expected] for name, values in evaluation["curves"].items()}
        expect(page.locator(".epsilon-reading")).to_have_text(f"ε = {curves['epsilon']:g}")
        for measure, share, interval in (
            ("miss", "miss_rate", "miss_interval"),
            ("power", "power", "power_interval"),
            ("fail", "fail_given_alert", "fail_given_alert_interval"),
        ):
            row = page.locator(f'[data-measure="{measure}"]')
            if curves[share] is None:  # no alert to count
                continue
            expect(row.locator(".meter-value")).to_have_text(percent(curves[share]))
            low, high = (f"{100 * bound:.1f}" for bound in curves[interval])
            expect(row).to_contain_text(f"95 %: {low} to {high} %")
        failing, safe = page.locator("[data-counts]").inner_text().split(". Safe flights: ")
        counts = [int(n.replace(",", "")) for n in re.findall(r"[\d,]*\d", failing)]
        assert counts[:2] == [curves["misses"], curves["withdrawn"]]
        assert sum(counts[:3]) == counts[3] == evaluation["n_unsafe"]
        counts = [int(n.replace(",", "")) for n in re.findall(r"[\d,]*\d", safe)]
        assert counts[:2] == [curves["false_alerts"], curves["safe_withdrawn"]]
        assert sum(counts[:3]) == counts[3] == evaluation["n_safe"]
        assert counts[2] / counts[3] == pytest.approx(curves["power"])
        expect(page.locator(".plot-rule-text", has_text="ε =").first).to_contain_text(
            f"{curves['epsilon']:g}"
        )


@pytest.mark.parametrize("width", [1280, 500])
def test_a_recipe_leaves_each_value_room_to_be_read(width: int, page: Page, site: Site) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    page.locator("summary", has_text="Recipe, origin").click()
    expect(page.locator(".recipe .recipe .recipe").first).to_be_attached()
    widths = page.eval_on_selector_all(
        ".recipe dd", "all => all.map((dd) => dd.getBoundingClientRect().width)"
    )
    assert min(widths) > 100


def test_a_method_is_a_predictor_and_a_score_that_go_together(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/new")
    method = page.get_by_label("method", exact=True)
    expect(method).to_have_value("ensemble")
    expect(method.locator("option").first).to_contain_text("(recommended)")
    expect(method.locator("option", has_text="(recommended)")).to_have_count(1)
    predictor, score = (page.locator(f'[name="monitor.{part}.kind"]') for part in PAIR)
    method.select_option("test_card")
    expect(predictor).to_have_value("response_filter")
    expect(score).to_have_value("card_window")
    page.get_by_text("Predictor, score, groups, promise, calibration, test flights").click()
    score.select_option("rest_of_card")
    expect(method).to_have_value("")
    method.select_option("outputs_ahead")
    expect(predictor).to_have_value("linear")


def test_a_form_begun_from_a_monitor_keeps_its_method(page: Page, site: Site) -> None:
    recipe = site.get(f"/monitors/{site.monitor}")["recipe"]
    page.goto(f"{site.http}/#/monitors/new?like={site.monitor}")
    for part in PAIR:
        expect(page.locator(f'[name="monitor.{part}.kind"]')).to_have_value(recipe[part]["kind"])


def test_texts_of_methods_and_of_datasets_of_one_recipe_are_read_in_a_narrow_window(
    page: Page, site: Site
) -> None:
    page.set_viewport_size({"width": 1024, "height": 768})
    page.goto(f"{site.http}/#/monitors/new")
    method = page.get_by_label("method", exact=True)
    widest = """(e) => {
        const pen = document.createElement("canvas").getContext("2d");
        pen.font = getComputedStyle(e).font;
        return Math.max(...[...e.options].map((o) => pen.measureText(o.text).width));
    }"""
    assert method.evaluate(widest) < method.evaluate("(e) => e.clientWidth") - 30
    stored = site.get("/datasets")[0]
    page.get_by_label("Use a stored dataset").check()
    option = page.get_by_label("stored dataset", exact=True).locator("option").first
    expect(option).to_contain_text(f"{stored['created'][:10]} {stored['created'][11:16]} UTC")


def test_the_form_knows_how_many_failures_an_epsilon_needs(page: Page, site: Site) -> None:
    page.goto(site.http)
    guarantees: tuple[Guarantee, ...] = ("average", "95%")
    cases: list[tuple[float, Guarantee]] = list(product((0.01, 0.02, 0.1, 0.3), guarantees))
    told = page.evaluate(
        """async (cases) => {
             const { neededFor } = await import("/js/monitors/train_form.js");
             return cases.map((each) => neededFor(...each));
           }""",
        cases,
    )
    assert told == [failures_needed(*case) for case in cases]


def test_every_unsafe_rollout_that_is_drawn_ends_with_a_cross(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    figure = page.locator("figure", has_text="Rollouts by outcome")
    expect(figure.locator("path.plot-mark.plot-unsafe")).to_have_count(1 + DRAWN)  # one in the key
    expect(figure.locator("path.plot-line.plot-safe")).to_have_count(1 + DRAWN)


def test_the_guarantee_is_in_words_and_the_monitor_can_be_flown(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    expect(page.locator(".promise")).to_have_text("P(no timely alert | the flight fails) ≤ epsilon")
    expect(page.locator("main")).to_contain_text("not the probability of failure")
    support = site.get(f"/monitors/{site.monitor}")["support"]
    for words in (f"At most {percent(support['level'])}", f"{support['n_safe']} safe"):
        expect(page.locator("main")).to_contain_text(words)
    page.get_by_role("button", name="Fly", exact=True).click()
    expect(page).to_have_url(re.compile(rf"#/fly\?monitor={site.monitor}"))


def test_a_monitor_of_no_use_says_so_and_is_flown_only_when_that_is_accepted(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    trained = site.store.monitors.get(site.monitor)
    evaluation = site.get(f"/monitors/{site.monitor}/evaluation")
    alerted = {"false_alerts": evaluation["n_safe"], "safe_withdrawn": 0}
    counts = evaluation["at_epsilon"] | alerted
    as_planned = evaluation | {"at_epsilon": counts, "robustness": {}}
    useless = replace(trained, evaluation=as_planned)
    made = site.store.monitors.add(useless, "cries wolf").id
    try:
        page.goto(f"{site.http}/#/monitors")
        mark = page.get_by_role("row", name="cries wolf").locator(".monitor-mark")
        expect(mark).to_have_text("◆ of no use")
        expect(mark).to_have_attribute("title", re.compile("of no use: only 0.0%"))
        page.goto(f"{site.http}/#/monitors/{made}")
        expect(page.locator(".monitor-warning").first).to_contain_text("of no use")
        page.goto(f"{site.http}/#/fly?monitor={made}")
        expect(page.locator(".monitor-warning")).to_contain_text("of no use")
        page.get_by_role("button", name="Start the flight").click()
        dialog = page.get_by_role("dialog")
        expect(dialog).to_contain_text("alerts mean nothing")
        dialog.get_by_role("button", name="Cancel").click()
        assert site.get("/flights") == []
        page.get_by_role("button", name="Start the flight").click()
        dialog.get_by_role("button", name="Fly anyway").click()
        page.wait_for_url("**/#/fly/*")
        (flight,) = site.get("/flights")
        assert flight["accept_useless"] is True
    finally:
        page.goto("about:blank")  # what it shows is about to be deleted
        for flight in site.get("/flights"):
            httpx2.post(f"{site.http}/api/v1/flights/{flight['id']}/end").raise_for_status()
            httpx2.delete(f"{site.http}/api/v1/flights/{flight['id']}").raise_for_status()
        site.store.monitors.delete(made)


def test_a_downloaded_monitor_is_uploaded_again_and_deleted(
    page: Page, site: Site, allowed_errors: list[str], tmp_path
) -> None:
    allowed_errors.append("404")  # it was never flown here: there is no evaluation
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    with page.expect_download() as download:
        page.get_by_role("link", name="Download").click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    assert file.name == f"monitor-{site.monitor}.fwm"
    page.goto(f"{site.http}/#/monitors")
    page.locator('input[type="file"]').set_input_files(file)
    expect(page.get_by_role("heading", level=1)).to_have_text(file.stem)
    expect(page.locator("main")).to_contain_text("Calibrated on")
    expect(page.locator("main")).not_to_contain_text("No test flights")  # the file carries it
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete permanently").click()
    expect(page).to_have_url(re.compile("#/monitors$"))
    expect(page.locator("tbody tr")).to_have_count(1)


def test_an_unknown_monitor_is_an_error_that_leads_back_to_the_list(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("404")
    page.goto(f"{site.http}/#/monitors/0123456789ab")
    state = page.locator(".state-error")
    expect(state).to_contain_text("0123456789ab")
    expect(state.get_by_role("button", name="Try again")).to_have_count(0)
    state.get_by_role("link", name="Back to the list").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Monitors")


def test_a_long_name_pushes_no_button_of_the_list_out_of_sight(own_page: Page, site: Site) -> None:
    page, long = own_page, "transonic_flutter_expansion_block_4_point_017_revision_2_of_3"

    def renamed(route: Route) -> None:
        (monitor, *_) = route.fetch().json()
        route.fulfill(json=[monitor | {"name": long}])

    page.route("**/api/v1/monitors", renamed)
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(f"{site.http}/#/monitors")
    scroll = page.locator(".table-scroll")
    expect(scroll).to_contain_text(long)
    assert scroll.evaluate("({ scrollWidth, clientWidth }) => scrollWidth <= clientWidth")


# Datasets


def test_a_dataset_labelled_by_margins_names_its_test_and_says_that_it_has_no_limits(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422")
    page.goto(f"{site.http}/#/datasets/new")
    field(page, "dataset.aircraft.kind").select_option("attas_id_16kft")
    margins = page.locator('details[data-path="dataset.margins"]')
    margins.locator("summary").click()
    expect(margins).to_contain_text("label rollouts, and judge nothing in flight")
    field(page, "dataset.margins.phase_deg").fill("180")
    field(page, "dataset.n_unsafe").fill("5")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(margins).to_contain_text("below 180")
    field(page, "dataset.margins.phase_deg").fill("73")
    page.get_by_role("button", name="Simulate", exact=True).click()
    page.wait_for_url(re.compile(r"#/datasets/\w{6,}$"))
    dataset = page.url.rpartition("/")[2]
    try:
        facts = page.locator("main")
        expect(facts).to_contain_text("none: failures are known by label only")
        expect(facts).to_contain_text("requirement phase margin > 73 deg")
        expect(facts).to_contain_text("ATTAS")
        expect(facts).not_to_contain_text("own simulator")
    finally:
        page.goto("about:blank")
        site.store.datasets.delete(dataset)


def test_leads_are_swept_on_a_datasets_test(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/sweep?dataset={site.dataset}")
    expect(page.get_by_text("No study yet")).to_be_visible()
    expect(field(page, "sweep.imperfections")).to_be_hidden()
    expect(page.get_by_label("test card: window", exact=True)).to_have_accessible_description(
        "forecast of the test card: for doublets, pulses and other steps"
    )
    for name in ("test card: window", "test card: rest", "predicted magnitude"):
        page.get_by_label(name, exact=True).uncheck()
    other = page.get_by_label("safe envelope", exact=True)
    expect(other).not_to_be_checked()
    other.check()
    page.get_by_label("warning lead times").fill("0.25 1.9")
    for name, number in (("n_unsafe", 25), ("n_monitors", 1), ("n_test", 80)):
        field(page, f"sweep.{name}").fill(str(number))
    page.get_by_role("button", name="Start the study").click()
    expect(page.locator("figure")).to_have_count(2, timeout=SLOW)
    (job,) = (job for job in site.get("/jobs") if job["kind"] == "sweep")
    (found,) = site.get(f"/jobs/{job['id']}")["result"]["tests"].values()
    assert len(found["cells"]) == 10
    page.locator("summary", has_text="All figures").click()
    row = page.get_by_role("row").nth(1)
    expect(row).to_contain_text(found["cells"][0]["method"])
    expect(row).to_contain_text(percent(found["cells"][0]["power"]))
    hopeless = page.get_by_text("clear the point before it is flown")
    expect(hopeless).to_have_count(int(bool(found["hopeless_s"])))
    page.goto(f"{site.http}/#/monitors/sweep")
    expect(page.locator(f'a[href="#/monitors/sweep?job={job["id"]}"]')).to_be_visible()


def test_an_epsilon_is_chosen_by_fresh_flights(page: Page, site: Site) -> None:
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    page.get_by_text("Choose an epsilon from fresh flights").click()
    field(page, "epsilon.n_test").fill("400")
    field(page, "epsilon.most_missed").fill("0.001")
    page.get_by_role("button", name="Fly and choose").click()
    expect(page.get_by_text("out of reach: missed at most 0.1 %")).to_be_visible(timeout=SLOW)
    page.get_by_role("button", name="Back").click()
    page.get_by_label("Choose", exact=True).select_option("cost")
    expect(field(page, "epsilon.most_missed")).to_be_hidden()
    page.get_by_role("button", name="Fly and choose").click()
    expect(page.get_by_text("Mean cost of a flight")).to_be_visible(timeout=SLOW)
    page.get_by_role("button", name="Fly it with this epsilon").click()
    expect(page).to_have_url(re.compile(rf"#/fly\?monitor={site.monitor}&epsilon=0\.\d+"))


def test_two_monitors_are_combined(page: Page, site: Site) -> None:
    stored = site.store.monitors.get(site.monitor)
    again = train(
        site.store.datasets.get(site.dataset), replace(stored.recipe.as_planned(), t_early=0.5)
    )
    later = site.store.monitors.add(again, "later", site.dataset).id
    page.goto(f"{site.http}/#/monitors")
    page.get_by_role("link", name="Combine monitors").click()
    page.get_by_role("button", name="Combine").click()
    expect(page.get_by_text("Choose at least two members")).to_be_visible()
    for name in ("card 7", "later"):
        page.get_by_label(name, exact=True).check()
    expect(page.get_by_label("warning lead time")).to_have_value("0.25")
    page.get_by_label("warning lead time").select_option("0.5")
    field(page, "combination.n_unsafe").fill("60")
    field(page, "combination.n_test").fill("60")
    page.get_by_role("button", name="Combine").click()
    title = page.get_by_role("heading", name="2 monitors as one, 0.5 s ahead")
    expect(title).to_be_visible(timeout=SLOW)
    expect(page.locator(".page-actions")).not_to_contain_text("false")
    expect(page.get_by_text("60 failures", exact=True)).to_be_visible()
    recipe = page.locator(".recipe-columns")
    expect(recipe).to_contain_text("highest risk")
    expect(recipe).to_contain_text("Member 2")
    expect(recipe).to_contain_text("s ahead: past failures and the peak still to come as one")
    for monitor in (later, page.url.rpartition("/")[2]):
        site.store.monitors.delete(monitor)


def test_a_dataset_in_use_is_not_deleted_and_the_sentence_says_by_what(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("409")
    page.goto(f"{site.http}/#/datasets/{site.dataset}")
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete permanently").click()
    expect(page.locator("dialog .error")).to_contain_text("is used by card 7")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("dialog")).to_have_count(0)
    assert [dataset["id"] for dataset in site.get("/datasets")] == [site.dataset]


def test_a_rollout_is_picked_looked_at_and_replayed(page: Page, site: Site) -> None:
    rollout = site.get(f"/datasets/{site.dataset}/rollouts/3")
    page.goto(f"{site.http}/#/datasets/{site.dataset}")
    page.get_by_label("number", exact=True).fill("3")
    page.keyboard.press("Enter")
    fails = f"{rollout['telemetry']['t'][-1]:.3g} s"
    expect(page.locator(".rollout-words")).to_contain_text(f"Rollout 3, unsafe: fails at {fails}")
    expect(page.locator(".rollout-strips .strip")).to_have_count(6)
    page.get_by_role("button", name="Replay with").click()
    expect(page).to_have_url(re.compile(r"#/fly/\w+$"))
    flight = site.get(f"/flights/{page.url.rpartition('/')[2]}")
    source = {"kind": "replay", "dataset": site.dataset, "outcome": "unsafe", "rollout": 3}
    assert flight["source"] == source
    page.goto("about:blank")
    page.request.post(f"{site.http}/api/v1/flights/{flight['id']}/end")


def test_nothing_is_wider_than_the_page(page: Page, site: Site) -> None:
    for view, ready in (
        ("monitors", "table"),
        ("monitors/new", "main form"),
        (f"monitors/{site.monitor}", "#epsilon"),
        (f"datasets/{site.dataset}", ".strip canvas"),
    ):
        page.goto(f"{site.http}/#/{view}")
        expect(page.locator(ready).first).to_be_visible()
        box = page.locator(".page")
        for width in (1280, 820):
            page.set_viewport_size({"width": width, "height": 720})
            beyond = box.evaluate("element => element.scrollWidth - element.clientWidth")
            assert beyond <= 0, (view, width)


def test_an_own_aircraft_is_uploaded_refused_and_removed_on_the_monitors_page(
    page: Page, site: Site, allowed_errors: list[str]
) -> None:
    allowed_errors.append("422 (")
    page.goto(f"{site.http}/#/monitors/{site.monitor}")
    page.get_by_text("Aircraft in the scene").click()
    choice = page.get_by_label("Aircraft as a .glb file")
    status = page.locator("details[open] [role=status]")
    expect(status).to_contain_text("fighter, transport or trainer")
    content = glb(((10, 1, 8), (0, 0, 0)))
    choice.set_input_files({"name": "own.glb", "mimeType": "model/gltf-binary", "buffer": content})
    expect(status).to_contain_text("uploaded by local")
    assert site.store.airframes.file(site.monitor) == content
    choice.set_input_files({"name": "x.glb", "mimeType": "model/gltf-binary", "buffer": b"solid"})
    expect(page.locator("details[open] .error")).to_contain_text("no binary glTF")
    page.reload()
    page.get_by_text("Aircraft in the scene").click()
    page.get_by_role("button", name="Remove it").click()
    expect(status).to_contain_text("fighter, transport or trainer")
    assert site.store.airframes.file(site.monitor) is None
