"""Units as people read them, in a real Chromium, against the real server."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from core.channels import BY_KEY
from tests.browser.site import open_site

UNITS = """async ([channel, value]) => {
    const { chooseSI, magnitudeIn, quantity } = await import("/js/lib/numbers.js");
    const said = (si) => (chooseSI(si), [quantity(channel, value), magnitudeIn(channel, value)]);
    return [said(false), said(true)];
}"""


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with open_site(tmp_path_factory.mktemp("units")) as server:
        yield server.http


SAID = {
    ("beta", 0.1221730476): (["7.00 deg", "7 deg"], ["0.122 rad", "0.1222 rad"]),
    ("r", -0.2): (["−11.5 deg/s", "−11.46 deg/s"], ["−0.200 rad/s", "−0.2 rad/s"]),
    ("Ny", 0.5): (["0.500 g", "0.5 g"], ["0.500 g", "0.5 g"]),
}
"""A reading and a limit, in degrees and in SI units."""


def test_readings_and_limits_are_said_in_degrees_or_si(page: Page, origin: str) -> None:
    page.goto(origin)
    for (key, value), (degrees, si) in SAID.items():
        channel = {**BY_KEY[key].__dict__}
        assert page.evaluate(UNITS, [channel, value]) == [degrees, si]


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
    expect(label).to_contain_text("[rad]")
    expect(beta).to_have_value("0.122173")
    beta.fill("0.1")
    units.click()
    expect(beta).to_have_value("5.72958")
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
