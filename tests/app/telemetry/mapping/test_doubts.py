"""What is said against a mapping made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from app.telemetry.mapping.doubts import find_doubts
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
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


def test_nothing_speaks_against_a_mapping_that_is_right(columns, right):
    assert find_doubts(columns, right) == {}


@pytest.mark.parametrize("key", ["beta", "p", "Ny", "delta_r"])
def test_a_sign_against_the_motion_is_said(key, columns, right):
    doubts = find_doubts(columns, changed(right, key, sign=-1))
    assert any("the motion says it is reversed" in text for text in doubts[key])


def test_an_offset_away_from_zero_is_said(columns, right):
    (text,) = find_doubts(columns, changed(right, "beta", offset=1.5))["beta"]
    assert text.endswith("rad to -1.5 rad, away from zero")
    centred = np.mean(columns.values("beta"))
    assert find_doubts(columns, changed(right, "beta", offset=float(centred))) == {}


def test_an_offset_of_an_accelerometer_is_said(columns, right):
    assert "constant offset" in " ".join(
        find_doubts(columns, changed(right, "Ny", offset=1.0))["Ny"]
    )


def test_a_signal_used_twice_is_said_of_both(columns, right):
    doubts = find_doubts(columns, changed(right, "r", signal="p"))
    assert "p is mapped to yaw rate too" in doubts["p"]
    assert "p is mapped to roll rate too" in doubts["r"]
    assert (
        "t is mapped to the time too" in find_doubts(columns, changed(right, "r", signal="t"))["r"]
    )


def test_a_unit_against_that_of_the_file_or_the_name_is_said(columns, right, tmp_path):
    doubts = find_doubts(columns, changed(right, "beta", unit="deg"))
    assert "the file says that beta is in rad, not in deg" in doubts["beta"]
    named = columns_of(tmp_path, {"t": columns.values("t"), "beta_deg": columns.values("beta")})
    mapping = Mapping({"beta": ChannelSource("beta_deg", "rad")}, {"": TimeSource("t")})
    assert find_doubts(named, mapping) == {
        "beta": ["its name says that beta_deg is in deg, not in rad"]
    }
    odd = changed(right, "Ny", signal="phi", unit="g")
    said = "the file says that phi is in rad, which is no lateral acceleration"
    assert said in find_doubts(columns, odd)["Ny"]


def test_what_cannot_be_applied_is_still_doubted(columns, right):
    odd = changed(changed(right, "r", signal="p"), "Ny", signal="no such")
    assert set(find_doubts(columns, odd)) == {"p", "r"}
