import pytest
from pydantic import TypeAdapter, ValidationError

from app.json_codec import Whole


@pytest.mark.parametrize("given", [3, 3.0])
def test_a_whole_number_is_taken_however_json_writes_it(given):
    assert TypeAdapter(Whole).validate_python(given) == 3


@pytest.mark.parametrize("given", [3.5, "3", True, float("inf"), None])
def test_nothing_else_is_taken_for_a_whole_number(given):
    with pytest.raises(ValidationError):
        TypeAdapter(Whole).validate_python(given)
