"""Formulas of computed channels: as numpy computes them, in flights and in streams, and refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from core.channels import LATERAL, Channel, Dictionary, channel
from core.computed import Computed, complete, fill
from core.formulas import MOST_CHARACTERS, Formula, FormulaError, parse, smallest_of_times
from core.types import Array

DT = 0.05
RNG = np.random.default_rng
NAMES = ("Nz", "mass", "α", "pitch rate")
MEASURED = tuple(channel(name, name, "1", name, "output", "absolute") for name in NAMES)


def computed(key: str, formula: str) -> Channel:
    return replace(channel(key, key, "N", key, "output", "absolute"), formula=formula)


def dictionary(**formulas: str) -> Dictionary:
    return Dictionary("own", (*MEASURED, *(computed(k, text) for k, text in formulas.items())))


def values(text: str, *columns: Array) -> Array:
    """Of a formula over samples DT apart."""
    t = np.arange(columns[0].shape[-1] if columns else 1, dtype=np.float64) * DT
    return parse(text, NAMES).values(columns, smallest_of_times(t))


def flights(n: int = 3, n_samples: int = 30, seed: int = 0) -> Array:
    return RNG(seed).normal(0, 2, (n, n_samples, len(NAMES)))


# --- as numpy computes ----------------------------------------------------------------------------

ATOMS = st.one_of(
    st.sampled_from(["Nz", "mass", "α", "[pitch rate]"]),
    st.floats(0, 1e3).map(repr),
    st.integers(0, 99).map(lambda k: f"{k}.0"),
)
EXPRESSIONS = st.recursive(
    ATOMS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", " * ", "/", "**"]), inner).map("".join),
        inner.map(lambda x: f"-{x}"),
        inner.map(lambda x: f"({x})"),
        st.tuples(st.sampled_from(["abs", "sqrt", "sin", "cos"]), inner).map(
            lambda parts: f"{parts[0]}({parts[1]})"
        ),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(
            lambda parts: f"{parts[0]}({parts[1]}, {parts[2]})"
        ),
    ),
    max_leaves=12,
)
NUMPY = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "min": np.minimum,
    "max": np.maximum,
}


@given(EXPRESSIONS)
def test_an_expression_is_what_numpy_makes_of_the_same_text(text: str) -> None:
    columns = flights()
    known = dict(zip(("Nz", "mass", "α", "pitch_rate"), np.moveaxis(columns, 2, 0), strict=True))
    python = text.replace("[pitch rate]", "pitch_rate")
    with np.errstate(all="ignore"):
        try:
            expected = np.asarray(eval(python, {}, NUMPY | known))
        except (ZeroDivisionError, OverflowError):
            assume(False)
            raise
    assume(expected.dtype == np.float64)
    got = values(text, *np.moveaxis(columns, 2, 0))
    np.testing.assert_array_equal(got, np.where(np.isfinite(expected), expected, np.nan))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-2**2", -4.0),
        ("2**-1", 0.5),
        ("2**3**2", 512.0),
        ("8/4/2", 1.0),
        ("8-4-2", 2.0),
        ("-(1 + 2)*3", -9.0),
        ("1.5e2 + .5", 150.5),
        ("min(3, 1, 2)", 1.0),
        ("max(3, 1, 2) + abs(-1)", 4.0),
        ("table(2.5, 0, 1, 2, 3, 4, 7)", 4.0),
        ("table(-9, -1, 5, 2, 3)", 5.0),
        ("table(9, -1, 5, 2, 3)", 3.0),
    ],
)
def test_operators_bind_as_in_python_and_tables_interpolate(text: str, expected: float) -> None:
    assert float(values(text)) == expected


@given(EXPRESSIONS)
def test_a_missing_input_gives_a_missing_value(text: str) -> None:
    nz, *others = np.moveaxis(flights(), 2, 0)
    nz[1] = np.nan
    for given_ in (f"{text} + Nz", f"1**Nz + ({text})", f"min(Nz**0, {text})"):
        assert np.isnan(values(given_, nz, *others)[1]).all()


def test_a_result_that_is_no_number_is_missing() -> None:
    nz = np.array([-1.0, 0.0, 4.0])
    np.testing.assert_array_equal(values("sqrt(Nz)", nz), [np.nan, 0.0, 2.0])
    np.testing.assert_array_equal(values("1/Nz", nz), [-1.0, np.nan, 0.25])


# --- persistence ----------------------------------------------------------------------------------


def smallest_of(x: Array, n: int) -> Array:
    """The plain twin: the smallest known value of the last n samples of each flight."""
    out = np.full_like(x, np.nan)
    for flight, row in enumerate(x):
        for k in range(len(row)):
            known = row[max(k - n + 1, 0) : k + 1]
            if not np.isnan(row[k]):
                out[flight, k] = np.nanmin(known)
    return out


@pytest.mark.parametrize(
    ("seconds", "n"), [(0.01, 1), (0.05, 2), (0.12, 3), (0.15, 4), (0.2, 5), (0.6, 13), (9.0, 181)]
)
def test_lasting_is_the_smallest_value_of_the_time(seconds: float, n: int) -> None:
    x = flights(4, 60)[..., 0]
    x[RNG(1).random(x.shape) < 0.1] = np.nan
    np.testing.assert_array_equal(values(f"lasting(Nz, {seconds})", x), smallest_of(x, n))
    np.testing.assert_array_equal(values(f"-lasting(-Nz, {seconds})", x), -smallest_of(-x, n))


def test_a_peak_that_is_shorter_than_the_time_does_not_last() -> None:
    x = np.ones((1, 40))
    x[0, 10:14], x[0, 20:25] = 5.0, 5.0
    assert np.flatnonzero(values("lasting(Nz, 0.2)", x)[0] == 5.0).tolist() == [24]


# --- streams --------------------------------------------------------------------------------------


@given(EXPRESSIONS, st.sampled_from([0.05, 0.12, 0.2, 3.0]), st.floats(-1e6, 1e6))
def test_a_stream_computes_the_same_bits_as_whole_flights(
    text: str, seconds: float, start: float
) -> None:
    own = dictionary(load=text, held=f"lasting(load, {seconds}) + lasting(Nz*α, 0.1)")
    y = flights(1, 40)
    y[RNG(1).random(y.shape) < 0.03] = np.nan
    (whole,) = complete(own, y, DT)
    running = Computed(own)
    for k, sample in enumerate(whole):
        given_ = sample.copy()
        given_[4:] = 7.0
        running.fill(start + k * DT, given_)
        np.testing.assert_array_equal(given_, sample)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.01, 0.07, 0.3, 2.0]))
def test_a_stream_computes_the_same_bits_as_samples_at_uneven_times(
    seed: int, seconds: float
) -> None:
    own = dictionary(held=f"lasting(Nz, {seconds}) - 2*lasting(-α, 0.1)")
    t = np.cumsum(RNG(seed).exponential(DT, 60))
    y = np.append(flights(1, 60, seed)[0], np.full((60, 1), np.nan), axis=1)
    y[RNG(seed).random(y.shape) < 0.05] = np.nan
    for arrived in (np.arange(60), np.argsort(t + RNG(seed).exponential(0.1, 60))):
        whole = np.append(y[arrived], np.full((60, 2), 7.0), axis=1)
        fill(own, t[arrived], whole)
        running = Computed(own)
        for at, sample, expected in zip(t[arrived], y[arrived], whole, strict=True):
            running.fill(at, sample)
            np.testing.assert_array_equal(expected, [*sample, 7.0, 7.0])


def test_late_samples_count_at_their_time_and_a_clock_set_back_begins_anew() -> None:
    own = dictionary(held="lasting(Nz, 0.2)")
    running = Computed(own)

    def held(t: float, nz: float) -> float:
        y = np.array([nz, 0.0, 0.0, 0.0, np.nan])
        running.fill(t, y)
        return y[4]

    assert [held(100.0, 2.0), held(100.1, 5.0), held(100.3, 5.0)] == [2.0, 2.0, 5.0]
    assert held(100.25, 3.0) == 3.0
    assert held(100.3, 6.0) == 3.0
    assert np.isnan(held(100.35, np.nan))
    assert held(100.4, 6.0) == 3.0
    assert held(100.9, 6.0) == 6.0
    assert held(5.0, 9.0) == 9.0
    assert held(5.1, 8.0) == 8.0


def test_a_dictionary_without_formulas_is_left_as_it_is() -> None:
    y = RNG(0).normal(size=(2, 5, 6))
    assert complete(LATERAL, y, DT) is y
    assert LATERAL.measured == LATERAL.keys
    sample = y[0, 0].copy()
    Computed(LATERAL).fill(0.0, sample)
    np.testing.assert_array_equal(sample, y[0, 0])


# --- dictionaries ---------------------------------------------------------------------------------


def test_measured_channels_are_completed_wherever_the_computed_ones_are() -> None:
    load = computed("load", "0.7*Nz*mass")
    own = Dictionary("own", (*MEASURED[:2], load, *MEASURED[2:], computed("more", "load + α")))
    y = flights()
    assert own.measured == NAMES
    whole = complete(own, y, DT)
    np.testing.assert_array_equal(whole[..., [0, 1, 3, 4]], y)
    np.testing.assert_array_equal(whole[..., 2], 0.7 * y[..., 0] * y[..., 1])
    np.testing.assert_array_equal(whole[..., 5], whole[..., 2] + y[..., 2])
    np.testing.assert_array_equal(complete(own, whole, DT), whole)


def test_the_sources_of_a_computed_channel_are_measured() -> None:
    own = dictionary(load="Nz*mass", held="lasting(load, 0.2)", other="α")
    assert own.sources(["held"]) == ("Nz", "mass")
    assert own.sources(["other", "Nz"]) == ("Nz", "α")
    assert own.sources(own.keys[4:]) == ("Nz", "mass", "α")
    assert LATERAL.sources(["r", "beta"]) == ("beta", "r")


def test_a_formula_is_stored_and_an_empty_one_is_not() -> None:
    own = dictionary(load="0.7*Nz")
    plain = own.to_plain()
    assert ["formula" in known for known in plain["channels"]] == [False] * 4 + [True]
    assert Dictionary.from_plain(plain) == own


@pytest.mark.parametrize(
    ("formulas", "words"),
    [
        ({"load": "0.7*Nzz"}, "channel load: formula .*'Nzz' at character 5.*did you mean Nz"),
        ({"a": "b", "b": "a"}, "channel a: .*'b' at character 1: not a channel before"),
        ({"a": "a"}, "not a channel before this one"),
        ({"load": 3}, "not text"),
    ],
)
def test_a_dictionary_refuses_a_formula_that_it_cannot_compute(
    formulas: dict[str, str], words: str
) -> None:
    plain = dictionary().to_plain()
    plain["channels"] += [{"key": k, "unit": "N", "formula": f} for k, f in formulas.items()]
    with pytest.raises(ValueError, match=words):
        Dictionary.from_plain(plain)


def test_computed_channels_are_outputs_beside_measured_ones() -> None:
    with pytest.raises(ValueError, match="computed channel is an output"):
        Dictionary("own", (*MEASURED, replace(computed("x", "Nz"), role="control")))
    with pytest.raises(ValueError, match="all channels have formulas"):
        Dictionary("own", (computed("x", "1"),))


# --- refused --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "it ends too early"),
        ("Nz +", "it ends too early"),
        ("2Nz", "'Nz' at character 2: an operator"),
        ("Nz mass", "'mass' at character 4"),
        ("Nz^2", "'\\^' at character 3"),
        ("(Nz", "\\) is needed"),
        ("Nz)", "'\\)' at character 3"),
        ("Nz.real", "'.' at character 3"),
        ("Nz[0]", "'0' at character 3"),
        ("__import__('os')", "did you mean|choose"),
        ("sine(Nz)", "did you mean sin"),
        ("(lambda: 1)()", "'lambda' at character 2: not a channel"),
        ("Nz if Nz else 1", "'if' at character 4"),
        ("pitch rate", "'pitch' at character 1: .*did you mean pitch rate"),
        ("[yaw rate]", "choose Nz, mass, α, pitch rate"),
        ("abs(Nz, 1)", "'\\,' at character 7"),
        ("max(Nz)", "two or more"),
        ("1e999", "finite number"),
        ("lasting(Nz)", ", is needed"),
        ("lasting(Nz, 0)", "at most 10 seconds"),
        ("lasting(Nz, 11)", "at most 10 seconds"),
        ("lasting(Nz, mass)", "'mass' at character 13: a finite number"),
        ("table(Nz, 1, 2)", "two or more points"),
        ("table(Nz, 1, 2, 3)", "two or more points"),
        ("table(Nz, 2, 1, 1, 2)", "ascending"),
        ("(" * 1000 + "Nz" + ")" * 900, "nested too deeply"),
        ("-" * 1000 + "Nz", "nested too deeply"),
        ("**".join(["9"] * 600), "nested too deeply"),
        ("+".join(["Nz"] * MOST_CHARACTERS), f"at most {MOST_CHARACTERS}"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_place(text: str, words: str) -> None:
    with pytest.raises(FormulaError, match=words):
        parse(text, NAMES)


def test_a_huge_power_is_a_missing_value() -> None:
    assert np.isnan(values("9**9**9**9**9**9"))


@given(st.text(alphabet="Nzmas 0123.,()[]+-*/_eα'\"\\\n^=:;", max_size=60))
def test_any_text_is_a_formula_or_refused(text: str) -> None:
    try:
        formula = parse(text, NAMES)
    except FormulaError:
        return
    assert isinstance(formula, Formula)
    columns = np.moveaxis(flights(1, 4), 2, 0)
    assert values(text, *columns).shape in ((), (1, 4))
