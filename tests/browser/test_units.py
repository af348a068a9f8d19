"""Units as people read them, in a real Chromium, against the real server."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from core.channels import BY_KEY, channel
from tests.browser.site import open_site

UNITS = """async ([channel, value]) => {
    const { chooseUnits, magnitudeIn, quantity, UNIT_SYSTEMS } = await import("/js/lib/numbers.js");
    const said = () => [quantity(channel, value), magnitudeIn(channel, value)];
    return UNIT_SYSTEMS.map((name) => (chooseUnits(name), said()));
}"""


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with open_site(tmp_path_factory.mktemp("units")) as server:
        yield server.http


SPEED = channel("V", "V", "m/s", "true airspeed", "condition", "absolute")
ALTITUDE = channel("h", "h", "m", "altitude", "condition", "absolute")
SAID = [
    (BY_KEY["beta"], 0.1221730476, ("7.00 deg", "7 deg"), None, ("0.122 rad", "0.1222 rad")),
    (BY_KEY["r"], -0.2, ("−11.5 deg/s", "−11.46 deg/s"), None, ("−0.200 rad/s", "−0.2 rad/s")),
    (BY_KEY["Ny"], 0.5, ("0.500 g", "0.5 g"), None, ("0.500 g", "0.5 g")),
    (SPEED, 180.0, ("180.0 m/s", "180 m/s"), ("349.9 kn", "349.9 kn"), ("180.0 m/s", "180 m/s")),
    (ALTITUDE, 3048.0, ("3048.0 m", "3048 m"), ("10000 ft", "10000 ft"), ("3048.0 m", "3048 m")),
]  # fmt: skip
"""A reading and a limit: in degrees, with knots and feet (None: the same), and in SI units."""


def test_readings_and_limits_are_said_in_each_system_of_units(page: Page, origin: str) -> None:
    page.goto(origin)
    for known, value, degrees, aviation, si in SAID:
        said = page.evaluate(UNITS, [vars(known), value])
        assert said == [list(degrees), list(aviation or degrees), list(si)]


def test_the_form_takes_degrees_and_sends_radians_and_the_choice_is_remembered(
    page: Page, origin: str
) -> None:
    page.goto(f"{origin}/#/monitors/new")
    beta = page.locator('[name="dataset.limits.beta"]')
    label = page.locator('[data-path="dataset.limits.beta"] label')
    expect(label).to_contain_text("[deg]")
    beta.fill("7")
    page.get_by_role("button", name="Suggest amplitude")
    with page.expect_request("**/datasets/amplitude") as sent:
        page.get_by_role("button", name="Suggest amplitude").click()
    asked = sent.value.post_data_json
    assert asked is not None
    assert asked["limits"]["beta"] == pytest.approx(np.radians(7))
    expect(page.locator(".suggestion")).to_contain_text("pilot rollouts", timeout=60_000)
    units = page.get_by_role("button", name=re.compile("^Units"))
    expect(units).to_have_text("Units: deg")
    units.click()
    expect(units).to_have_text("Units: kn, ft")
    expect(beta).to_have_value("7")
    units.click()
    expect(label).to_contain_text("[rad]")
    expect(beta).to_have_value("0.122173")
    beta.fill("0.1")
    units.click()
    expect(beta).to_have_value("5.72958")
    units.click()
    units.click()
    expect(beta).to_have_value("0.1")
    page.reload()
    expect(units).to_have_text("Units: SI")
    expect(label).to_contain_text("[rad]")


FIELDS = {
    "control_law.kr": ("yaw damper gain kr [s]", "Rudder per washed-out yaw rate"),
    "control_law.kp": ("roll damper gain kp [s]", "Aileron per roll rate"),
    "aircraft.n_states": ("number of states", "4 with bank angle phi, or 3 as in the paper"),
    "maneuver.half_s": ("length of each half [s]", ""),
}


def test_a_form_calls_its_fields_by_the_fields_words_with_units(page: Page, origin: str) -> None:
    page.goto(f"{origin}/#/monitors/new")
    for path, (label, hint) in FIELDS.items():
        field = page.locator(f'[data-path="dataset.{path}"]')
        expect(field.locator("label")).to_have_text(label)
        expect(field.locator(".hint")).to_have_text(hint)
