import re
from dataclasses import fields, replace

import jsonschema_rs
import pytest

from app.catalog import (
    RECIPES,
    amplitude_request_schema,
    catalog,
    dataset_request_schema,
    descriptions,
    first_line,
    monitor_request_schema,
    schema_of,
    unit_of,
)
from app.recipes.labels import KINDS, choice_label
from core.bounds import bounds_of
from core.limits.limits import Limits
from core.planned_test.collection import DatasetRecipe
from core.recipe import FAMILIES
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import MANEUVERS, Maneuver, Table


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
    assert own["t_s"] == "times after the trim segment: increasing, from 0."
    assert (
        own["lead_in_s"]
        == inherited["lead_in_s"]
        == "length of the trim segment: before the first input."
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


BOUNDED = [DatasetRecipe(), RECIPES["monitor"], RECIPES["study"], Limits(), DatasetRecipe().noise]
BOUNDED += [DatasetRecipe().imperfections, DatasetRecipe().imperfections.quantisation]


@pytest.mark.parametrize("recipe", BOUNDED, ids=lambda recipe: type(recipe).__name__)
def test_bounds_are_published_as_they_are_checked(recipe):
    properties, every = schema_of(recipe)["properties"], bounds_of(type(recipe))
    assert every
    for name, bounds in every.items():
        below_least = None if bounds.least is None else bounds.least - 1
        for number in (below_least, bounds.above, bounds.below):
            if number is not None:
                assert not jsonschema_rs.is_valid(properties[name], number), name
                with pytest.raises(ValueError, match=f"{name}="):
                    replace(recipe, **{name: number})
        if bounds.least is not None:
            assert jsonschema_rs.is_valid(properties[name], bounds.least), name


def test_what_is_too_small_is_refused_by_the_documents_of_requests_too():
    for schema in (dataset_request_schema(), amplitude_request_schema()):
        assert jsonschema_rs.is_valid(schema, {"n_unsafe": 2, "noise": {"p": 0.0}})
        assert not jsonschema_rs.is_valid(schema, {"n_unsafe": 1})
        assert not jsonschema_rs.is_valid(schema, {"noise": {"p": -1.0}})
        assert not jsonschema_rs.is_valid(schema, {"imperfections": {"gain": -1.0}})
        assert jsonschema_rs.is_valid(schema, {"imperfections": "none"})
    monitor = {"dataset": {"n_unsafe": 2}}
    assert jsonschema_rs.is_valid(monitor_request_schema(), monitor)
    assert not jsonschema_rs.is_valid(monitor_request_schema(), monitor | {"epsilon": 1.0})


def _parameters(schema, where):
    """Path, key and schema of every parameter, those of parameters within too."""
    for key, entry in schema["properties"].items():
        yield f"{where}.{key}", key, entry
        if "properties" in entry and "x-family" not in entry:
            yield from _parameters(entry, f"{where}.{key}")


SCHEMAS = {
    f"{name}.{kind}": entry["schema"]
    for name, family in catalog()["families"].items()
    for kind, entry in family["entries"].items()
} | {name: schema_of(recipe) for name, recipe in RECIPES.items()}


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_parameter_is_called_by_the_fields_words_and_not_by_its_identifier(name):
    for path, key, entry in _parameters(SCHEMAS[name], name):
        title = entry["title"]
        assert title != key, path
        assert 3 < len(title) < 60, path
        assert not set("[]:;`") & set(title), path


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_choice_is_called_by_the_fields_words(name):
    for path, key, entry in _parameters(SCHEMAS[name], name):
        if "enum" in entry and key != "model":  # the names of JSBSim
            assert entry["x-labels"] == [choice_label(key, choice) for choice in entry["enum"]]
            assert all(" " in label or "_" not in label for label in entry["x-labels"]), path


def test_no_member_is_called_by_a_key_that_is_no_words():
    for family in catalog()["families"].values():
        for kind in family["entries"]:
            assert kind in KINDS or re.fullmatch("[a-z_]+", kind), kind


@pytest.mark.parametrize(
    ("member", "key", "title", "unit_"),
    [
        (next(iter(AIRCRAFT.values())), "n_states", "number of states", ""),
        (CONTROL_LAWS["f16_damper"], "kr", "yaw damper gain k_r", "s"),
        (CONTROL_LAWS["f16_damper"], "kp", "roll damper gain k_p", "s"),
        (MANEUVERS["rudder_doublet"], "half_s", "length of each half", "s"),
        (DatasetRecipe(), "maneuver", "Manoeuvre", ""),
    ],
)
def test_a_title_is_the_head_of_a_description(member, key, title, unit_):
    entry = schema_of(member)["properties"][key]
    assert (entry["title"], entry.get("x-unit", "")) == (title, unit_)


def test_the_sweep_calls_a_method_as_the_form_does():
    swept, form = catalog()["sweep_methods"], catalog()["methods"]
    assert {method["label"] for method in form} < set(swept.values())
    assert len(set(swept.values())) == len(swept)


def test_the_list_of_aircraft_names_the_user_s_own_model() -> None:
    entry = catalog()["families"]["aircraft"]["entries"]["matrices"]
    assert entry["label"] == entry["description"].split(";")[0] == "Your own model (matrices)"
