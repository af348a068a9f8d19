"""Warnings about a mapping made by a person."""

from dataclasses import replace

import numpy as np
import pytest

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from core.channels import KEYS
from tests.support.tables import columns_of, flight

UNITS = {"p": "rad/s", "r": "rad/s", "Ny": "g", "phi": "rad", "t": "s"}
ATTAS = "attas_id_16kft"


@pytest.fixture(scope="module")
def columns(tmp_path_factory):
    channels = flight(ATTAS)
    table = {key: channels[key] for key in ("t", *KEYS, "phi")}
    units = {key: UNITS.get(key, "rad") for key in table}
    return columns_of(tmp_path_factory.mktemp("columns"), table, units=units)


@pytest.fixture(scope="module")
def right():
    named = {key: ChannelSource(key, UNITS.get(key, "rad")) for key in (*KEYS, "phi")}
    return Mapping(named, {"": TimeSource("t")})


def changed(mapping, key, **how):
    return replace(
        mapping, channels=mapping.channels | {key: replace(mapping.channels[key], **how)}
    )


def warnings_about(columns, mapping):
    try:
        applied = apply_mapping(columns, mapping)
    except TelemetryError:
        applied = None
    return find_warnings(columns, mapping, applied)


def test_a_correct_mapping_has_no_warning(columns, right):
    assert warnings_about(columns, right) == {}


@pytest.mark.parametrize("key", ["beta", "p", "Ny", "delta_r"])
def test_a_sign_against_the_motion_gives_a_warning(key, columns, right):
    warnings = warnings_about(columns, changed(right, key, sign=-1))
    assert any("according to the motion it is reversed" in text for text in warnings[key])


def test_a_bias_away_from_zero_gives_a_warning(columns, right):
    (text,) = warnings_about(columns, changed(right, "beta", bias=1.5))["beta"]
    assert text.endswith("deg to -85.9 deg, away from zero")
    centred = np.mean(columns.values("beta"))
    assert warnings_about(columns, changed(right, "beta", bias=float(centred))) == {}


def test_a_bias_of_an_accelerometer_gives_a_warning(columns, right):
    assert "constant bias" in " ".join(
        warnings_about(columns, changed(right, "Ny", bias=1.0))["Ny"]
    )


def test_a_signal_used_twice_gives_a_warning_on_both(columns, right):
    warnings = warnings_about(columns, changed(right, "r", signal="p"))
    assert "p is also mapped to yaw rate" in warnings["p"]
    assert "p is also mapped to roll rate" in warnings["r"]
    assert (
        "t is also mapped to the time"
        in warnings_about(columns, changed(right, "r", signal="t"))["r"]
    )


def test_a_unit_that_differs_from_file_or_name_gives_a_warning(columns, right, tmp_path):
    warnings = warnings_about(columns, changed(right, "beta", unit="deg"))
    assert "the file gives beta in rad, not in deg" in warnings["beta"]
    named = columns_of(tmp_path, {"t": columns.values("t"), "beta_deg": columns.values("beta")})
    mapping = Mapping({"beta": ChannelSource("beta_deg", "rad")}, {"": TimeSource("t")})
    assert warnings_about(named, mapping) == {
        "beta": ["its name gives beta_deg in deg, not in rad"]
    }
    odd = changed(right, "Ny", signal="phi", unit="g")
    text = "the file gives phi in rad, which is not a unit of lateral acceleration"
    assert text in warnings_about(columns, odd)["Ny"]


def test_a_mapping_that_cannot_be_applied_still_gives_warnings(columns, right):
    odd = changed(changed(right, "r", signal="p"), "Ny", signal="no such")
    assert set(warnings_about(columns, odd)) == {"p", "r"}
