import jsonschema_rs
import pytest

from app.catalog import catalog, dataset_request_schema, monitor_request_schema
from app.messages import DOWN, UP, UPLINK_DOWN, UPLINK_UP
from app.recipes.recipes import from_plain
from core.channels import KEYS
from core.limits.limits import SPECIFICATIONS
from core.monitor import MonitorRecipe
from core.planned_test.collection import DatasetRecipe
from core.recipe import FAMILIES
from core.simulation.maneuver import LATERAL_MANEUVERS
from tests.support.api import api, document

ENTRIES = [
    pytest.param(family, kind, id=f"{family}-{kind}")
    for family, content in catalog()["families"].items()
    for kind in content["entries"]
]


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    with api(tmp_path_factory.mktemp("data")) as client:
        return client.get("/api/v1/catalog").json()


def test_every_member_of_every_family_is_published(published):
    known = [*(family.members for family in FAMILIES.values()), SPECIFICATIONS]
    listed = [list(family["entries"]) for family in published["families"].values()]
    assert sorted(map(sorted, listed)) == sorted(map(sorted, known))


def test_channels_are_in_the_order_of_y(published):
    assert tuple(channel["key"] for channel in published["channels"]) == KEYS


@pytest.mark.parametrize(("family", "kind"), ENTRIES)
def test_defaults_fit_their_schema(published, family, kind):
    entry = published["families"][family]["entries"][kind]
    jsonschema_rs.validate(entry["schema"], entry["default"])
    assert entry["description"]
    for name, parameter in entry["schema"]["properties"].items():
        assert parameter["default"] == entry["default"][name]


@pytest.mark.parametrize(("family", "kind"), ENTRIES)
def test_defaults_are_those_of_the_family(published, family, kind):
    default = published["families"][family]["entries"][kind]["default"]
    members = FAMILIES[family].members if family in FAMILIES else SPECIFICATIONS
    assert from_plain(members[kind], default) == members[kind]


@pytest.mark.parametrize(("family", "kind"), ENTRIES)
def test_a_misspelt_parameter_does_not_fit(published, family, kind):
    schema = published["families"][family]["entries"][kind]["schema"]
    assert not jsonschema_rs.is_valid(schema, {"misspelt": 1})


def test_recipes_have_their_defaults(published):
    recipes = published["recipes"]
    assert from_plain(DatasetRecipe(n_unsafe=7), recipes["dataset"]["default"]) == DatasetRecipe()
    assert from_plain(MonitorRecipe(epsilon=0.3), recipes["monitor"]["default"]) == MonitorRecipe()
    for recipe in recipes.values():
        jsonschema_rs.validate(recipe["schema"], recipe["default"])
    flown = recipes["dataset"]["as_flown"]
    jsonschema_rs.validate(recipes["dataset"]["schema"], flown)
    assert from_plain(DatasetRecipe(), flown) == DatasetRecipe().as_trained()
    assert recipes["study"]["as_flown"] is None
    usual = from_plain(DatasetRecipe(), recipes["dataset"]["usual"])
    assert usual == DatasetRecipe(n_unsafe=500).as_trained()
    assert recipes["monitor"]["usual"]["guarantee"] == "95%"


def test_a_part_of_a_family_names_it(published):
    properties = published["recipes"]["dataset"]["schema"]["properties"]
    for name in ("aircraft", "control_law", "maneuver"):
        family = published["families"][properties[name]["x-family"]]
        kinds = properties[name]["properties"]["kind"]["enum"]
        known = LATERAL_MANEUVERS if name == "maneuver" else family["entries"]
        assert kinds == list(known)


def test_request_schemas_contain_the_recipe():
    assert dataset_request_schema()["properties"].keys() > {"aircraft", "dt", "n_unsafe", "name"}
    assert monitor_request_schema()["properties"].keys() > {"dataset", "t_early", "score"}


def test_published_schemas_have_no_references(published):
    assert "$ref" not in str(published["families"]) + str(published["recipes"])


def test_every_stream_message_is_described():
    described = document()
    schemas = described["components"]["schemas"]
    for kind in (*DOWN, *UP, *UPLINK_DOWN, *UPLINK_UP):
        assert kind.__name__ in schemas
        assert kind.__name__ in described["info"]["description"]
    whole = {"$ref": "#/components/schemas/Credit", "components": described["components"]}
    jsonschema_rs.validate(whole, {"type": "credit", "n": 1})
    with pytest.raises(jsonschema_rs.ValidationError):
        jsonschema_rs.validate(whole, {"type": "credit", "n": 0})
    whole["$ref"] = "#/components/schemas/SentBatch"
    jsonschema_rs.validate(whole, {"sequence": 1, "t": [0.0], "beta": [None], "body": {"p": 0.1}})
    with pytest.raises(jsonschema_rs.ValidationError):
        jsonschema_rs.validate(whole, {"sequence": 1, "t": "now"})
