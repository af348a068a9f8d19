from dataclasses import dataclass, fields

import pytest

from app.catalog import descriptions, first_line, schema_of, unit_of
from core.collection import DatasetRecipe
from core.recipe import FAMILIES
from core.specification import Limits


@dataclass(frozen=True)
class Base:
    """A base."""

    speed: float = 1.0
    """how fast [m/s]."""
    turn_deg: float = 2.0
    """how far,
    over two lines."""


@dataclass(frozen=True)
class Part(Base):
    """What it is, in
    two lines.

    Some words on it.
    """

    speed: float = 2.0
    """its own words [kt]."""
    a: tuple[float, ...] = ()
    """inputs [rad]."""
    rest: int = 0


def unit(schema, name):
    return schema["properties"][name].get("x-unit", "")


def test_attribute_docstrings_describe_and_give_the_unit():
    schema = schema_of(Part())
    assert schema["properties"]["turn_deg"]["description"] == "how far, over two lines."
    assert unit(schema, "turn_deg") == "deg"
    assert schema["properties"]["rest"]["description"] == unit(schema, "rest") == ""


def test_a_class_describes_better_than_its_base():
    assert descriptions(Part)["speed"] == "its own words [kt]."
    assert unit(schema_of(Part()), "speed") == "kt"
    assert unit(schema_of(Base()), "speed") == "m/s"


def test_a_matrix_has_no_unit_of_its_own():
    assert descriptions(Part)["a"] == "inputs [rad]."
    assert unit(schema_of(Part()), "a") == ""


def test_the_first_line_is_the_first_paragraph():
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
    assert unit(schema_of(DatasetRecipe()), "dt") == "s"


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
