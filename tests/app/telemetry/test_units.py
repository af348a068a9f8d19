from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.units import (
    BASIC,
    CHOICES,
    choices,
    convert,
    factor,
    fits,
    spelled,
)

SPELLINGS = {
    "deg": "deg DEG Deg ° º degree degrees [deg] (deg) grad deg.",
    "rad": "rad RAD radian radians",
    "deg/s": "deg/s DEG/S degps deg_s dps °/s deg/sec degrees/second deg_per_s deg.s-1 deg·s⁻¹",
    "rad/s": "rad/s radps rad_s r/s RAD/SEC rad_sec rad·s^-1 radians/second",
    "g": "g G g's gs gn gees",
    "m/s^2": "m/s2 m/s^2 m/s² m/s**2 mps2 m_s2 m/s/s M/S2 ms-2 m·s⁻² m.s-2 meters/second^2",
    "ft/s^2": "ft/s2 ft/s² fps2 ft_s2 ft/sec2",
    "m/s": "m/s mps m_s M/S m.s-1 meter/sec",
    "kt": "kt kts knots KTS kn KTAS Knot",
    "kN": "kN [kN] kilonewton",
    "kN*m": "kN*m kilonewton*m",
    "ft/s": "ft/s fps ft_s feet/second",
    "km/h": "km/h kmh kph",
    "ft/min": "ft/min fpm ft_min",
    "m": "m M meter metres",
    "ft": "ft FT feet foot",
    "FL": "FL fl flight_level",
    "s": "s S sec seconds",
    "ms": "ms MS msec milliseconds",
    "us": "us µs μs usec microseconds",
    "ns": "ns nanoseconds",
    "Hz": "Hz HZ hertz",
}
PER_UNIT = [
    ("deg", "rad", pi / 180),
    ("°/s", "rad/s", pi / 180),
    ("rev/min", "rad/s", pi / 30),
    ("mrad", "rad", 1e-3),
    ("cdeg", "rad", pi / 18000),
    ("0.01 deg", "rad", pi / 18000),
    ("m/s2", "g", 1 / 9.80665),
    ("ft/s2", "g", 0.3048 / 9.80665),
    ("mg", "g", 1e-3),
    ("kt", "m/s", 1852 / 3600),
    ("kN*m", "N*m", 1000.0),
    ("km/h", "m/s", 1 / 3.6),
    ("ft/s", "m/s", 0.3048),
    ("FL", "m", 30.48),
    ("us", "s", 1e-6),
    ("day", "s", 86400.0),
    ("seconds since 2019-03-12 00:00", "s", 1.0),
    ("ms", "s", 1e-3),
    ("ms", "m/s", 1.0),
]
NO_UNITS = [
    "",
    "-",
    "1",
    "foo",
    "bananas/s",
    "m/",
    "/s",
    "deg/s/foo",
    "deg--s",
    "n/a",
    "EU",
    "\x00",
]


@pytest.mark.parametrize(
    ("text", "ours"), [(text, ours) for ours, texts in SPELLINGS.items() for text in texts.split()]
)
def test_a_unit_is_known_in_every_spelling(text, ours):
    assert spelled(text) == ours


@pytest.mark.parametrize("text", NO_UNITS)
def test_a_text_that_is_not_a_unit_has_no_spelling(text):
    assert spelled(text) == ""
    with pytest.raises(TelemetryError, match="is not a known unit: give one of rad, deg"):
        factor(text, "rad")


@pytest.mark.parametrize(("text", "target", "expected"), PER_UNIT)
def test_a_unit_has_its_published_size(text, target, expected):
    assert factor(text, target) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("%", "rad"),
        ("Hz", "rad/s"),
        ("deg", "rad/s"),
        ("deg/s", "rad"),
        ("psi", "rad"),
        ("kg", "g"),
        ("degC", "rad"),
        ("degC", "K"),
        ("ft/min", "m"),
        ("V", "m/s"),
        ("m/s", "g"),
    ],
)
def test_a_unit_of_another_kind_is_refused(text, target):
    assert not fits(text, target)
    with pytest.raises(TelemetryError, match=f"which is in {target}: give one of {target}"):
        factor(text, target)


@pytest.mark.parametrize("target", [*TARGETS.values()], ids=[*TARGETS])
def test_every_target_offers_its_own_unit_first_and_only_such_as_fit(target):
    offered = choices(target.unit)
    assert offered[0] == target.unit
    assert all(fits(unit, target.unit) for unit in offered)
    assert factor(target.unit, target.unit) == 1.0


@pytest.mark.parametrize("unit", [unit for units in CHOICES.values() for unit in units])
def test_an_offered_unit_is_spelled_as_it_is_offered(unit):
    assert spelled(unit) == unit


@pytest.mark.parametrize("unit", BASIC)
def test_a_unit_is_spelled_the_same_by_another_pass(unit):
    assert spelled(spelled(unit)) == spelled(unit) == unit


@given(
    st.sampled_from([(unit, target) for target, units in CHOICES.items() for unit in units]),
    st.floats(1e-6, 1e6),
)
def test_converting_there_and_back_restores_the_value(pair, number):
    unit, target = pair
    converted = convert(np.array([number]), unit, target)
    np.testing.assert_allclose(convert(converted, target, target), converted, rtol=0)
    back = convert(converted, unit, target) / factor(unit, target)
    np.testing.assert_allclose(back, converted, rtol=1e-14)
    assert factor(unit, target) * factor(target, unit) == pytest.approx(1.0, rel=1e-15)


@given(st.floats(-1e3, 1e3))
def test_degrees_give_the_same_proposal_as_radians(angle):
    (radians,) = convert(np.array([np.rad2deg(angle)]), "deg", "rad")
    assert radians == pytest.approx(angle, rel=1e-14, abs=1e-300)


@given(st.integers(0, 10**9))
def test_milliseconds_become_the_nearest_number_of_seconds(milliseconds):
    (seconds,) = convert(np.array([float(milliseconds)]), "ms", "s")
    assert seconds == milliseconds / 1000


def test_values_in_the_unit_of_the_target_are_not_touched():
    values = np.array([0.1, np.nan])
    assert convert(values, "RAD/SEC", "rad/s") is values


@given(st.text(max_size=12))
def test_any_text_can_be_parsed_as_a_unit(text):
    ours = spelled(text)
    assert spelled(ours) == ours


SIZES = {
    "rad": {"deg": 0.017453292519943295, "mrad": 0.001, "cdeg": 0.00017453292519943294},
    "rad/s": {"deg/s": 0.017453292519943295},
    "g": {"m/s^2": 0.10197162129779283, "ft/s^2": 0.031080950171567256, "mg": 0.001},
    "m/s": {"kt": 0.5144444444444445, "ft/s": 0.3048, "km/h": 0.2777777777777778},
    "m": {"ft": 0.3048, "FL": 30.48, "km": 1000.0},
    "s": {"ms": 0.001, "us": 1e-06, "ns": 1e-09, "min": 60.0, "h": 3600.0, "day": 86400.0},
}


@pytest.mark.parametrize("target", SIZES)
def test_common_units_have_the_same_size_to_the_bit_in_every_version(target):
    assert {unit: factor(unit, target) for unit in choices(target)[1:]} == SIZES[target]
