"""Wrong input is told by its field, what was given and what is needed, in no library's words."""

from typing import Annotated, Any, Literal, get_args

import pytest
from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError
from pydantic_core.core_schema import ErrorType

from app.recipes.input_errors import NEEDED, input_errors
from app.recipes.recipes import RecipeError, from_plain
from core.planned_test.collection import DatasetRecipe


class Rollout(BaseModel):
    kind: Literal["rollout"]
    rollout: Annotated[int, Field(strict=True, ge=0)]


class Seeded(BaseModel):
    kind: Literal["seeded"]
    seed: int


class Body(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    value: StrictBool | float | None = None
    parts: Literal["all"] | Annotated[list[Rollout], Field(min_length=1)] = "all"
    source: Annotated[Rollout | Seeded, Field(discriminator="kind")] | None = None
    name: Annotated[str, Field(min_length=1, max_length=3)] = "a"


@pytest.mark.parametrize(
    ("plain", "said"),
    [
        ({"value": "x"}, "value is 'x': give true or false, or a number"),
        ({"parts": "some"}, "parts is 'some': give 'all', or a list"),
        ({"parts": []}, "parts is a list of 0: give 'all', or 1 or more of them"),
        (
            {"parts": [{"kind": "rollout", "rollout": -1}]},
            "parts is a list of 1: give 'all'; parts.0.rollout is -1: give 0 or more",
        ),
        ({"source": {"kind": "rollout"}}, "source.rollout is missing: give it"),
        (
            {"source": {"kind": "rollout", "rollout": "2"}},
            "source.rollout is '2': give a whole number",
        ),
        (
            {"source": {"kind": "x"}},
            "source is of kind 'x': give one whose 'kind' is 'rollout', 'seeded'",
        ),
        ({"name": "long"}, "name is 'long': give text of 3 characters or less"),
        ({"name": None}, "name is null: give text"),
        ({"colour": 1}, "colour is unknown: leave it out, or correct its name"),
        (7, "the input is 7: give an object"),
    ],
)
def test_a_wrong_value_is_told_by_its_field_and_what_it_needs(plain: Any, said: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Body.model_validate(plain)
    errors = refused.value.errors()
    assert "; ".join(map(str, input_errors(errors, plain))) == said


def test_the_kinds_of_errors_are_those_of_the_library() -> None:
    assert NEEDED.keys() <= set(get_args(ErrorType))


def test_a_recipe_is_refused_in_the_same_words() -> None:
    with pytest.raises(RecipeError, match=r"^dataset.n_unsafe is 'x': give a number$"):
        from_plain(DatasetRecipe(), {"n_unsafe": "x"}, "dataset")
    with pytest.raises(RecipeError, match=r"^dataset.n_unsafe is 2.5: give a whole number$"):
        from_plain(DatasetRecipe(), {"n_unsafe": 2.5}, "dataset")
    with pytest.raises(RecipeError, match=r"^dt=0.0 s was given: it must be positive"):
        from_plain(DatasetRecipe(), {"dt": 0.0}, "dataset")
