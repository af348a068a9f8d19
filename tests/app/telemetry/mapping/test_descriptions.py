"""Descriptions of signals in a file: a NetCDF long_name, a comment, a table of parameters."""

import pytest

from app.telemetry.contents import ColumnWriter, Signal, open_columns
from app.telemetry.mapping.names import signal_matches
from app.telemetry.mapping.proposal import propose
from app.telemetry.units import spelled
from core.channels import KEYS
from tests.support.tables import flight

LONG_NAMES = {
    "t": ("c00", "Time since start", "s"),
    "beta": ("c01", "Sideslip angle from the nose boom", "rad"),
    "p": ("c02", "Aircraft roll rate about the body x axis (rad/s)", ""),
    "r": ("c03", "yaw angular rate, rad/s", ""),
    "Ny": ("c04", "Lateral body acceleration at the cg [g]", ""),
    "delta_a": ("c05", "Aileron deflection, positive trailing edge down", "rad"),
    "delta_r": ("c06", "Rudder surface position", "rad"),
    "phi": ("c07", "Roll angle of the aircraft", "rad"),
    "V": ("c08", "True air speed, corrected for static pressure", "m/s"),
}


def matches(name, description):
    return signal_matches(Signal(name, "", 0, description))


def test_signals_known_only_by_description_are_mapped(tmp_path):
    writer = ColumnWriter(tmp_path, 2**30)
    group = writer.add_group()
    for key, (name, description, unit) in LONG_NAMES.items():
        signal = writer.add_signal(group, name, unit, description, time=key == "t")
        writer.append(signal, flight()[key])
    writer.finish("netcdf")
    proposal = propose(open_columns(tmp_path))
    for key in (*KEYS, "phi", "V"):
        name, _, unit = LONG_NAMES[key]
        source = proposal.mapping.channels[key]
        assert source.signal == name
        assert not unit or source.unit == unit
        assert proposal.rationales[key].confidence > 0.6


@pytest.mark.parametrize(
    ("name", "description", "key", "unit"),
    [
        ("AOSS", "Angle of side slip, deg", "beta", "deg"),
        ("R", "Roll rate (deg/s)", "p", "deg/s"),
        ("x1", "rate of roll", "p", ""),
        ("x1", "left aileron position (deg)", "delta_a_left", "deg"),
        ("x1", "True airspeed, corrected for static pressure", "V", ""),
        ("THDG", "True heading angle from north", "psi", ""),
    ],
)
def test_a_description_identifies_a_signal_and_its_unit(name, description, key, unit):
    first = matches(name, description)[0]
    assert (first.key, spelled(first.unit)) == (key, unit)
    assert first.certainty > 0.6


@pytest.mark.parametrize(
    ("name", "description"),
    [
        ("P", "static pressure"),
        ("p", "roll rate command"),
        ("x1", "Rudder pedal position"),
        ("x1", "rate of change of sideslip"),
        ("x1", "temperature of the yaw rate sensor"),
        ("beta", "pitch rate"),
        (
            "x1",
            "the angle that the nose makes with the path, once the aircraft has sideslip at all",
        ),
    ],
)
def test_a_description_of_another_quantity_is_not_a_channel(name, description):
    assert all(match.certainty < 0.4 for match in matches(name, description))


@pytest.mark.parametrize("description", ["", "channel 17 of the second recorder", "see the report"])
def test_a_description_that_means_nothing_changes_nothing(description):
    assert matches("beta", description) == matches("beta", "")
