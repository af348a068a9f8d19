from dataclasses import dataclass, fields

import pytest

from app.field_notes import field_notes, first_line
from core.collection import DatasetRecipe
from core.recipe import FAMILIES
from core.specification import Limits


@dataclass(frozen=True)
class Base:
    """A base.

    speed: how fast [m/s].   turn_deg: how far,
        over two lines.
    """

    speed: float = 1.0
    turn_deg: float = 2.0


@dataclass(frozen=True)
class Part(Base):
    """What it is, in
    two lines.

    Some words on it: not a parameter.
    speed: its own words [kt].   a (n, n), b (n, 2): inputs [rad].
    kr, kp [s]: gains.
    Raises ValueError: never.
    """

    a: tuple[float, ...] = ()
    b: tuple[float, ...] = ()
    kr: float = 0.0
    kp: float = 0.0
    rest: int = 0


def test_words_and_units_are_read_from_the_docstring():
    notes = field_notes(Part)
    assert notes["turn_deg"].description == "how far, over two lines."
    assert notes["turn_deg"].unit == "deg"
    assert notes["rest"].description == notes["rest"].unit == ""
    assert notes["kp"].description == "gains."


def test_a_class_describes_better_than_its_base():
    assert field_notes(Part)["speed"].description == "its own words [kt]."
    assert field_notes(Part)["speed"].unit == "kt"
    assert field_notes(Base)["speed"].unit == "m/s"


def test_a_matrix_has_no_unit_of_its_own():
    assert field_notes(Part)["a"].description == field_notes(Part)["b"].description
    assert field_notes(Part)["a"].unit == ""


def test_the_first_line_is_the_first_paragraph():
    assert first_line(Part) == "What it is, in two lines."


def test_channels_lend_their_units():
    assert {name: note.unit for name, note in field_notes(Limits).items()} == {
        "beta": "rad",
        "p": "rad/s",
        "r": "rad/s",
        "Ny": "g",
        "delta_a": "rad",
        "delta_r": "rad",
    }
    assert field_notes(DatasetRecipe)["dt"].unit == "s"


@pytest.mark.parametrize(
    "member",
    [pytest.param(m, id=k) for family in FAMILIES.values() for k, m in family.members.items()],
)
def test_every_parameter_named_in_a_unit_has_it(member):
    notes = field_notes(type(member))
    for name in (field.name for field in fields(member)):
        for suffix, unit in (
            ("_deg", "deg"),
            ("_hz", "Hz"),
            ("_rad_s", "rad/s"),
            ("_deg_s", "deg/s"),
        ):
            if name.endswith(suffix):
                assert notes[name].unit == unit
