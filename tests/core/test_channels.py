"""Displays use degrees, deg/s and g; computation uses SI."""

from math import radians

import pytest

from core.channels import BY_KEY, significant


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("beta", radians(7.0), "7 deg"),
        ("delta_r", -radians(3.14159), "-3.14 deg"),
        ("p", radians(1234.5), "1234 deg/s"),
        ("Ny", 0.51234, "0.512 g"),
        ("r", 0.0, "0 deg/s"),
    ],
)
def test_a_value_is_displayed_in_its_display_unit_to_three_digits(
    key: str, value: float, words: str
):
    assert BY_KEY[key].read(value) == words


def test_large_numbers_are_written_without_a_power_of_ten():
    assert [significant(x) for x in (999.7, 1234.0, 0.012345)] == ["1000", "1234", "0.0123"]
