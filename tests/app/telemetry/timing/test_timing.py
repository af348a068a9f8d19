"""Repair times only where that is certain, and report it."""

import json
from dataclasses import asdict

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.telemetry.recording import TelemetryError, Trace, Traces
from app.telemetry.timing.clock_faults import WRAPS
from app.telemetry.timing.clock_repair import evened
from app.telemetry.timing.quality import MOST_FAULTS, Fault, Quality
from app.telemetry.timing.repair import repair
from core.types import Array
from tests.support.repetition import examples

N = 2000
ROW = np.arange(N, dtype=np.float64)
"""Values equal to their row number, for channels with a wide plausible range."""
T = ROW / 100.0


def traces(t: Array, x: Array = ROW, **more: Trace) -> Traces:
    """Two channels on one clock, and more on theirs."""
    return Traces({"h": Trace(t, x), "theta": Trace(t, -0.5 * x)} | more)


def repaired(t: np.ndarray, x: Array = ROW, **more: Trace) -> tuple[Trace, Quality]:
    """The first channel and the quality of all; checks what holds for every repair."""
    recorded = traces(np.asarray(t, np.float64), x, **more)
    result = repair(recorded)
    fixed, quality = result.traces, result.quality
    assert msgspec.json.encode(asdict(quality))  # which takes no numbers of NumPy's
    assert json.dumps(asdict(quality), allow_nan=False)
    for key, trace in fixed.channels.items():
        assert (np.diff(trace.t) > 0.0).all()
        assert trace.t.shape == trace.values.shape
        assert np.isfinite(trace.t).all()
        assert not np.isinf(trace.values).any(), key
    assert fixed.channels["theta"].t is fixed.channels["h"].t
    assert list(fixed.notes) == [line for clock in quality.clocks for line in clock.repairs()]
    assert set(fixed.notes) <= set(quality.sentences())
    return fixed.channels["h"], quality


def kinds(quality: Quality) -> set[str]:
    return {fault.kind for fault in quality.faults}


def test_good_times_stay_the_same_array():
    fixed, quality = repaired(T)
    assert fixed.t is T
    assert fixed.values is ROW
    clock = quality.clocks[0]
    assert (clock.channels, clock.n_rows, clock.start, clock.end) == (("h", "theta"), N, 0.0, 19.99)
    assert clock.rate == pytest.approx(100.0)
    assert clock.jitter < 1e-9
    assert quality.faults == ()
    assert quality.sentences() == ["h, theta: 2000 rows at 100 Hz, from 0 to 19.99 s."]


def test_rows_without_a_time_are_removed():
    t = T.copy()
    t[[7, 900]], t[33] = np.nan, -np.inf
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, np.delete(ROW, [7, 33, 900]))
    assert (quality.clocks[0].bad_times, quality.clocks[0].n_gaps) == (3, 3)
    assert "3 rows without a time removed" in quality.sentences()[1]


@settings(max_examples=examples(30))
@given(seed=st.integers(0, 2**32 - 1), depth=st.integers(2, 160))
def test_late_packets_are_sorted_by_time(seed, depth):
    rng = np.random.default_rng(seed)
    order = np.arange(N)
    for begin in rng.integers(0, N - depth, 3):
        order[begin : begin + depth] = rng.permutation(order[begin : begin + depth])
    fixed, quality = repaired(T[order], order.astype(float))
    np.testing.assert_array_equal(fixed.values, ROW)
    np.testing.assert_array_equal(fixed.t, T)
    late = order < np.maximum.accumulate(order)
    assert quality.clocks[0].reordered == late.sum()
    assert quality.clocks[0].sets == ()


def test_rows_swapped_in_pairs_are_sorted():
    order = np.arange(N) ^ 1
    fixed, _ = repaired(T[order], ROW[order])
    np.testing.assert_array_equal(fixed.values, ROW)


def test_rows_recorded_newest_first_are_reversed():
    fixed, quality = repaired(T[::-1].copy(), ROW[::-1])
    np.testing.assert_array_equal(fixed.values, ROW)
    assert quality.clocks[0].backward


def test_rows_written_twice_count_once():
    index = np.sort(np.append(np.arange(N), [5, 5, 700, N - 1]))
    fixed, quality = repaired(T[index], ROW[index])
    np.testing.assert_array_equal(fixed.values, ROW)
    assert (quality.clocks[0].repeated, quality.clocks[0].conflicting) == (4, 0)
    assert [fault.start for fault in quality.faults if fault.kind == "repeated"] == [
        0.05,
        7.0,
        19.99,
    ]


def test_a_packet_sent_again_later_counts_once():
    index = np.concatenate([np.arange(900), np.arange(880, 900), np.arange(900, N)])
    fixed, quality = repaired(T[index], ROW[index])
    np.testing.assert_array_equal(fixed.values, ROW)
    assert (quality.clocks[0].repeated, quality.clocks[0].sets) == (20, ())


def test_the_first_of_two_values_at_one_time_is_used_with_a_note():
    t = T.copy()
    t[501] = t[500]
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, np.delete(ROW, 501))
    assert quality.clocks[0].conflicting == 1
    assert "1 row with a repeated time removed (1 with other values)" in quality.sentences()[1]


@pytest.mark.parametrize("name", WRAPS)
def test_a_counter_that_wraps_is_continued(name):
    t = np.round(np.mod(WRAPS[name] - 10.0 + T, WRAPS[name]), 6)
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, ROW)
    np.testing.assert_allclose(fixed.t, WRAPS[name] - 10.0 + T, atol=1e-5)
    assert quality.clocks[0].wraps == (name,)
    assert f"continued beyond {name}" in quality.sentences()[1]


def test_a_clock_that_began_after_the_wrap_is_continued_too():
    period = WRAPS["the end of a 32-bit counter of microseconds"]
    t = np.mod(period - 10.0 + T, period)
    psi = Trace(2.0 + ROW[:60] / 10.0, ROW[:60])
    result = repair(traces(t, psi=psi))
    np.testing.assert_allclose(result.traces.channels["psi"].t, psi.t + period)
    assert result.quality.clocks[1].wraps


@settings(max_examples=examples(60))
@given(back=st.floats(0.021, 40.0), at=st.integers(2, N - 2), step=st.sampled_from([0.01, 0.05]))
def test_two_passes_of_a_clock_are_never_merged(back, at, step):
    assume(back > 3 * step)  # less may be a row that comes late
    cheapest = min(at, N - at, 2 * back / step)
    assume(abs(cheapest - 0.1 * N) > 5)
    t = step * ROW
    t[at:] -= back
    if cheapest > 0.1 * N:
        with pytest.raises(TelemetryError, match="split the file at that row"):
            repaired(t)
        return
    fixed, quality = repaired(t)
    assert (np.diff(fixed.values) > 0.0).all()  # rows in the order they were recorded
    assert len(fixed.t) >= 0.9 * N
    assert quality.clocks[0].lost == N - len(fixed.t) > 0
    assert len(quality.clocks[0].sets) == 1
    passes = (fixed.values >= at).astype(int)
    if 0 < passes.sum() < len(passes):
        before, after = fixed.t[passes == 0], fixed.t[passes == 1]
        assert not np.isin(before, after).any()
        assert after.min() > before.max()


def test_a_leap_second_leaves_a_gap_and_a_note():
    t = T.copy()
    t[1000:] -= 0.5
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, np.delete(ROW, np.s_[950:1050]))
    assert Fault(9.5, 9.99, "clock") in quality.faults
    assert any(s.kind == "gap" and s.start < 9.5 and s.end > 9.99 for s in quality.faults)
    assert (
        "clock jumps from 9.99 s to 9.5 s; 100 rows with an ambiguous time removed"
        in (quality.sentences()[1])
    )


def test_times_ambiguous_on_one_clock_are_ambiguous_on_all():
    t = T.copy()
    t[1000:] -= 0.5
    slow = np.arange(0.0, 19.0, 1.3)
    _, quality = repaired(t, V=Trace(slow, slow), phi=Trace(np.append(slow, 19.4), np.zeros(16)))
    assert 9.1 in np.round(slow, 6)
    ambiguous = ((slow >= 9.5) & (slow <= 9.99)).sum()
    assert [clock.lost for clock in quality.clocks[1:]] == [ambiguous, ambiguous]


def test_a_clock_set_at_the_start_loses_the_rows_before():
    t = T + 1.7e9
    t[:50] = T[:50]
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, ROW[50:])
    assert quality.clocks[0].sets == ((0.49, 1.7e9 + 0.5),)


def test_stray_times_are_removed():
    t = T.copy()
    t[300], t[700], t[1500:1503] = 1e9, 0.0, [80.0, 80.01, 80.02]
    fixed, quality = repaired(t)
    np.testing.assert_array_equal(fixed.values, np.delete(ROW, [300, 700, 1500, 1501, 1502]))
    assert quality.clocks[0].lost == 5


@pytest.mark.parametrize(
    ("t", "words"),
    [
        (np.where(ROW < 1000, T, T - 8.0), r"jumps from 9\.99 s to 2 s at row 1001, which"),
        (np.random.default_rng(0).uniform(0, 1e5, N), "choose another signal as the time"),
        (np.random.default_rng(0).uniform(0, 4.9, 50 * N), "step back at more than 1000 places"),
        (np.random.default_rng(0).uniform(0, 1e5, 50 * N), "by more than .* s at .* places"),
        (20.0 * np.abs(np.sin(0.001 * ROW)), "with an ambiguous time: choose another"),
        (np.random.default_rng(0).normal(size=N).cumsum(), "fall from .* s in small steps until"),
        (1e-12 * ROW, "lie within 2e-09 s: choose the correct unit"),
        (1e15 + ROW, "0 of 2000 rows .* choose another time signal or unit"),
        (np.zeros(N), "1 of 2000 rows of h, theta have a distinct time"),
        (np.full(N, np.nan), "0 of 2000 rows of h, theta have a distinct time"),
    ],
)
def test_ambiguous_times_are_refused_with_numbers(t, words):
    with pytest.raises(TelemetryError, match=words):
        repair(traces(t, np.arange(len(t), dtype=np.float64)))


@pytest.mark.parametrize("cut", [np.floor, np.rint])
@pytest.mark.parametrize(
    ("rate", "unit"), [(60.0, 1e-3), (64.0, 0.01), (50.0, 0.1), (50.0, 1.0), (59.94, 1e-3)]
)
def test_rounded_times_of_an_even_clock_are_restored(rate, unit, cut):
    true = ROW / rate
    fixed, quality = repaired(np.round(unit * cut(true / unit + 1e-9), 9))
    np.testing.assert_array_equal(fixed.values, ROW)
    np.testing.assert_allclose(np.diff(fixed.t), 1.0 / rate, atol=1e-12)
    assert np.abs(fixed.t - true).max() <= 0.5 * unit
    assert quality.clocks[0].rounded_to == pytest.approx(unit)
    assert f"restored to an even rate of {rate:g} Hz" in quality.sentences()[1]


def test_times_in_single_precision_are_restored():
    fixed, _ = repaired((3000.0 + T).astype(np.float32).astype(np.float64))
    np.testing.assert_allclose(fixed.t, 3000.0 + T, atol=1e-9)


def test_rounded_times_keep_gaps_and_pauses():
    rows = np.sort(np.random.default_rng(1).choice(N, N - 40, replace=False))
    true = ROW / 60.0
    fixed, quality = repaired(np.round(true, 3)[rows], ROW[rows])
    np.testing.assert_allclose(fixed.t, true[rows], atol=1e-9)
    assert quality.clocks[0].n_gaps > 30
    paused = np.where(ROW < 1000, true, true + 7.1234)
    fixed, quality = repaired(np.round(paused, 3))
    np.testing.assert_allclose(np.delete(np.diff(fixed.t), 999), 1.0 / 60.0, atol=1e-5)
    assert np.abs(fixed.t - paused).max() <= 1e-3
    assert quality.clocks[0].longest_gap == pytest.approx(7.1234 + 1 / 60, abs=2e-3)


@pytest.mark.parametrize(
    "t",
    [
        T,
        1.76e9 + T,
        np.cumsum(np.full(N, 0.01)),
        np.round(T + np.random.default_rng(0).uniform(-0.004, 0.004, N), 3),
        np.round(ROW / 60.0 * (1.0 + 1e-3 * ROW / N), 3),
        np.delete(T, np.s_[::100]),  # lost rows, not a clock of 99 Hz rounded to 0.01 s
        np.sort(np.append(T, T[50::100])),  # double rows, not one of 101 Hz
    ],
)
def test_times_that_rounding_does_not_explain_are_left_alone(t):
    assert evened(t) is None


def test_gaps_are_found_with_their_place_and_length():
    t = np.delete(T, [*range(300, 350), 1200])
    _, quality = repaired(t, np.delete(ROW, [*range(300, 350), 1200]))
    clock = quality.clocks[0]
    assert (clock.n_gaps, clock.longest_gap_at) == (2, 2.99)
    assert (clock.gap_time, clock.longest_gap) == (pytest.approx(0.53), pytest.approx(0.51))
    assert quality.faults == (Fault(2.99, 3.5, "gap"), Fault(11.99, 12.01, "gap"))
    assert "2 gaps, 0.53 s in total, the longest 0.51 s at 2.99 s" in quality.sentences()[1]


def test_uneven_steps_are_jitter_not_gaps():
    rng = np.random.default_rng(4)
    _, quality = repaired(T + rng.uniform(-0.002, 0.002, N))
    clock = quality.clocks[0]
    assert clock.n_gaps == 0
    assert clock.jitter == pytest.approx(0.002 * np.sqrt(2 / 3), rel=0.1)
    assert f"jitter {clock.jitter:.2g} s rms" in quality.sentences()[0]


def test_missing_values_are_placed_and_blanks_of_a_slow_channel_are_its_rate():
    x, slow = ROW.copy(), np.full(N, np.nan)
    x[500:520], x[900] = np.nan, np.inf
    slow[::10] = ROW[::10]
    _, quality = repaired(T, x, phi=Trace(T, slow), psi=Trace(T, np.full(N, np.nan)))
    altitude, _, phi, psi = quality.channels
    assert (altitude.missing, altitude.longest_missing) == (21 / N, pytest.approx(0.21))
    assert Fault(4.99, 5.2, "missing:h") in quality.faults
    assert (phi.rate, phi.longest_missing) == (pytest.approx(10.0), pytest.approx(0.09))
    assert psi.missing == 1.0
    assert Fault(0.0, 19.99, "missing:psi") in quality.faults
    assert "psi has no values." in quality.sentences()


def test_a_frozen_sensor_is_distinguished_from_a_slow_coarse_or_dead_one():
    rng = np.random.default_rng(5)
    frozen, coarse = 0.1 * rng.normal(size=N), np.round(np.sin(0.3 * T), 2)
    frozen[800:1400] = frozen[800]
    held = np.repeat(rng.normal(size=N // 10), 10)
    channels = {"beta": frozen, "phi": coarse, "psi": held, "V": np.full(N, 3.0), "h": ROW}
    quality = repair(Traces({key: Trace(T, x) for key, x in channels.items()})).quality
    beta, phi, psi, v, h = quality.channels
    assert (beta.frozen, beta.frozen_at) == (pytest.approx(5.99), pytest.approx(8.0))
    assert [c.frozen for c in (phi, psi, v, h)] == [0.0] * 4
    assert [c.held for c in quality.channels] == [1, 1, 10, 1, 1]
    assert [c.constant for c in quality.channels] == [False, False, False, True, False]
    assert quality.faults == (Fault(8.0, 13.99, "frozen:beta"),)
    text = " ".join(quality.sentences())
    assert "beta is frozen for 5.99 s from 8 s" in text
    assert "psi repeats each value 10 times: it was measured at 10 Hz" in text
    assert "V never changes" in text


def test_a_strip_stays_drawable_whatever_the_recording():
    t = np.linspace(0.0, 500.0, 50_000)
    x = 2.0 * t
    x[::7] = np.nan
    _, quality = repaired(t, x)
    assert len(quality.faults) <= 2 * MOST_FAULTS
    assert kinds(quality) == {"missing:h", "missing:theta"}


def test_implausible_values_are_missing_and_named():
    beta, p, ay = 0.01 * np.sin(T), 0.1 * np.cos(T), 0.1 * np.sin(T)
    wild, far = p.copy(), ay.copy()
    wild[700:720], far[1000] = 1e30, -9e99
    recorded = {"beta": beta, "p": wild, "Ny": far}
    result = repair(Traces({key: Trace(T, x) for key, x in recorded.items()}))
    fixed, quality = result.traces, result.quality
    assert fixed.channels["beta"].values is beta
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(fixed.channels["p"].values)), range(700, 720)
    )
    assert np.isnan(fixed.channels["Ny"].values[1000])
    assert recorded["p"][700] == 1e30, "the numbers of the file stay"
    assert [c.implausible for c in quality.channels] == [0, 20, 1]
    assert (quality.channels[2].largest, quality.channels[2].largest_at) == (-9e99, 10.0)
    assert quality.channels[1].longest_missing == pytest.approx(0.21)
    assert Fault(10.0, 10.0, "implausible:Ny") in quality.faults
    assert {"implausible:p", "missing:p"} <= kinds(quality)
    (sentence,) = (line for line in fixed.notes if line.startswith("Ny exceeds"))
    assert "plausible 30 g in 1 row (up to -9e99 g, at 10 s)" in sentence
    assert sentence in quality.sentences()
    assert json.dumps(asdict(quality), allow_nan=False)
