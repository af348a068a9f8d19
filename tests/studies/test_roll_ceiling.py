"""Ceiling of the roll tests: exact outputs tell more, and power is at exactly epsilon."""

import numpy as np
import pytest

from tests.studies.roll_ceiling import TESTS as ROLLS
from tests.studies.roll_ceiling import RollCeilingRecipe, in_words, power, reached, warned

NAME = "bank to bank, p"


def test_power_is_that_of_the_score_that_misses_epsilon() -> None:
    unsafe, safe = np.arange(10.0), np.array([7.5, 8.5, 9.5, 20.0])
    assert power(unsafe, safe, 0.1) == 0.75
    assert power(unsafe, safe, 0.0) == 0.5


def test_a_warner_that_sees_true_outputs_is_quiet_more_often() -> None:
    recipe = RollCeilingRecipe(tests=(NAME,), n_flights=1_500)
    test = ROLLS[NAME]
    rows = [
        reached(NAME, who, scores, judged, test, recipe)
        for who, scores, judged in warned(test, recipe)
    ]
    of = {row.warner: row for row in rows}
    assert of["boosted, exact"].power > of["boosted"].power
    assert of["peaks"].power > 0.7
    assert "bank to bank" in in_words(rows, recipe)


def test_an_unknown_test_is_refused() -> None:
    with pytest.raises(ValueError, match="bank to bank"):
        RollCeilingRecipe(tests=("loop",))
