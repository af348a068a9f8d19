from dataclasses import fields

import pytest

from app.catalog import descriptions, first_line, schema_of, unit_of
from core.collection import DatasetRecipe
from core.recipe import FAMILIES
from core.simulation.aircraft import AIRCRAFT
from core.simulation.maneuver import Maneuver, Table
from core.specification import Limits


def unit(schema, name):
    return schema["properties"][name].get("x-unit", "")


def test_attribute_docstrings_describe_and_give_the_unit():
    schema = schema_of(DatasetRecipe())
    entry = schema["properties"]["dt"]
    assert (entry["description"], entry["x-unit"]) == ("sample interval of the telemetry [s].", "s")
    assert schema["properties"]["substeps"]["description"].endswith("counts at the later one.")
    assert unit(schema, "substeps") == ""


def test_a_class_inherits_descriptions():
    own, inherited = descriptions(Table), descriptions(Maneuver)
    assert own["t_s"] == "increasing, from 0."
    assert (
        own["lead_in_s"]
        == inherited["lead_in_s"]
        == "length of the trim segment, before the first input."
    )


def test_a_matrix_has_no_unit_of_its_own():
    schema = schema_of(AIRCRAFT["matrices"])
    assert "[rad]" in schema["properties"]["a"]["description"]
    assert unit(schema, "a") == ""


def test_the_first_line_is_the_first_paragraph():
    class Part:
        """What it is, in
        two lines.

        Some words on it.
        """

    assert first_line(Part) == "What it is, in two lines."


def test_channels_lend_their_units():
    schema = schema_of(Limits())
    assert {name: unit(schema, name) for name in schema["properties"]} == {
        "beta": "rad",
        "p": "rad/s",
        "r": "rad/s",
        "Ny": "g",
        "delta_a": "rad",
        "delta_r": "rad",
    }
    assert descriptions(Limits)["beta"] == "sideslip β"


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("turn_deg", "deg"),
        ("start_hz", "Hz"),
        ("washout_rad_s", "rad/s"),
        ("rate_deg_s", "deg/s"),
        ("duration_s", "s"),
        ("n", ""),
    ],
)
def test_a_name_that_ends_in_a_unit_has_it(name, unit):
    assert unit_of(name, "") == unit


@pytest.mark.parametrize(
    "member",
    [pytest.param(m, id=k) for family in FAMILIES.values() for k, m in family.members.items()],
)
def test_every_parameter_named_in_a_unit_has_it(member):
    schema = schema_of(member)
    for name in (field.name for field in fields(member)):
        for suffix, expected in (
            ("_deg", "deg"),
            ("_hz", "Hz"),
            ("_rad_s", "rad/s"),
            ("_deg_s", "deg/s"),
        ):
            if name.endswith(suffix):
                assert unit(schema, name) == expected
