"""Raw counts as quantities: bits against strings of ones and zeros, scale and offset by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.telemetry.recording import TelemetryError
from app.telemetry.scaling import AS_RECORDED, Scaling, read_bits


@st.composite
def fields(draw):
    low = draw(st.integers(1, 32))
    return low, draw(st.integers(low, 32)), draw(st.sampled_from(["", "signed"]))


@given(st.integers(0, 2**32 - 1), fields())
def test_a_field_is_read_from_the_digits_of_the_word(word, field):
    low, high, kind = field
    digits = f"{word:032b}"[32 - high : 33 - low]
    expected = int(digits, 2) - (int(digits[0]) << len(digits) if kind else 0)
    assert read_bits(f"{low}-{high} {kind}".strip()).of(np.array([float(word)])) == [expected]


@given(st.integers(-(2**15), 2**15 - 1), st.integers(1, 16))
def test_a_signed_word_is_the_same_as_one_without_sign(word, high):
    field = read_bits(f"1-{high} signed")
    np.testing.assert_array_equal(
        field.of(np.array([float(word)])), field.of(np.array([float(word & 0xFFFF)]))
    )


def arinc(data: int, status: int) -> float:
    """A word without its label: data in bits 11 to 29, status in bits 30 and 31."""
    return float((data & 0x7FFFF) << 10 | status << 29)


def test_a_bnr_word_counts_in_normal_operation_only():
    words = np.array([arinc(data, status) for data in (-5, 262143) for status in range(4)])
    nan = np.nan
    expected = [nan, nan, nan, -5, nan, nan, nan, 262143]
    np.testing.assert_array_equal(read_bits("11-29 bnr").of(words), expected)


def test_bcd_digits_have_the_sign_of_the_status_matrix():
    data = 0x71234  # five digits, the highest of three bits
    words = np.array([arinc(data, status) for status in range(4)])
    expected = [71234, np.nan, np.nan, -71234]
    np.testing.assert_array_equal(read_bits("11-29 BCD").of(words), expected)
    no_digit = np.array([arinc(0x1A, 0), float(0x9321 - 0x10000)])
    np.testing.assert_array_equal(read_bits("11-18 bcd").of(no_digit[:1]), [np.nan])
    np.testing.assert_array_equal(read_bits("1-16 bcd").of(no_digit[1:]), [9321])


def test_what_is_no_word_is_missing():
    raw = np.array([3.0, 3.5, np.nan, np.inf, -np.inf, 1e300])
    np.testing.assert_array_equal(read_bits("1").of(raw), [1, *[np.nan] * 5])


@pytest.mark.parametrize("text", ["", "0-3", "5-4", "1-53", "1:4", "4 float", "-3", "1-4 bnr bcd"])
def test_other_texts_are_refused_with_an_example(text):
    with pytest.raises(TelemetryError, match=r"5-16 signed|1 to 52"):
        read_bits(text)


def test_a_scale_and_an_offset_are_those_of_the_raw_number():
    raw = np.array([0.0, 100.0, -3.0])
    scaling = Scaling(0.5, -20.0)
    np.testing.assert_array_equal(scaling(raw), [-20.0, 30.0, -21.5])
    assert str(scaling) == "0.5 * raw - 20"
    assert str(Scaling(bits="1-4")) == "bits 1-4"
    assert AS_RECORDED(raw) is raw
    assert str(AS_RECORDED) == ""
