from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.telemetry.csv_reader import read
from app.telemetry.recording import Array, Recording, TelemetryError
from app.telemetry.resampling import MAX_ROWS, resample

RECORDS = Path(__file__).parents[1] / ".." / "shared" / "data"
SLOPES = np.array([1.0, -2.0, 0.0, 0.5, 3.0, -0.1])
OFFSETS = np.array([0.1, 0.2, 0.3, -0.4, 0.0, 7.0])


def clock(step: float, n: int) -> Array:
    return step * np.arange(n, dtype=np.float64)


def line(t: Array) -> Recording:
    return Recording(t, OFFSETS + SLOPES * t[:, None])


def sine(t: Array, hz: float) -> Recording:
    return Recording(t, np.sin(2 * np.pi * hz * t)[:, None] * np.ones(6))


@settings(deadline=None)
@given(
    step=st.floats(0.005, 0.062),  # with the jitter no step is a gap
    n=st.integers(2, 200),
    origin=st.floats(-1e3, 1e4),
    jitter=st.floats(0.0, 0.2),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_line_is_resampled_exactly(step, n, origin, jitter, seed):
    uneven = jitter * np.random.default_rng(seed).uniform(-0.5, 0.5, n)
    record = line(origin + step * (np.arange(n) + uneven))
    even = resample(record, 0.05)
    np.testing.assert_allclose(even.t, record.t[0] + 0.05 * np.arange(len(even.t)), atol=1e-9)
    assert record.t[-1] - 0.05 < even.t[-1] + 1e-7
    taken_as_on_the_grid = 1e-6 * 0.05 * np.abs(SLOPES).max()
    np.testing.assert_allclose(even.y, line(even.t).y, rtol=0, atol=1.01 * taken_as_on_the_grid)


@pytest.mark.parametrize(("rate_hz", "dt"), [(25, 0.04), (20, 0.05), (60, 1 / 60), (100, 0.01)])
@pytest.mark.parametrize("origin", [0.0, 3412.0])
def test_a_recording_on_the_grid_is_returned_as_it_is(rate_hz, dt, origin):
    record = sine(origin + np.arange(1000) / rate_hz, 1.0)
    assert resample(record, dt) is record


def test_samples_on_the_grid_survive_lost_neighbours_bit_for_bit():
    whole = sine(clock(0.05, 40), 0.7)
    kept = np.delete(np.arange(40), [5, 20, 21, 22])
    even = resample(Recording(whole.t[kept], whole.y[kept]), 0.05)
    np.testing.assert_array_equal(even.y[kept], whole.y[kept])
    assert np.isnan(even.y[[5, 20, 21, 22]]).all()
    assert "left open: 2, the longest 0.2 s" in even.notes[-1]


@pytest.mark.parametrize("step", [0.07, 0.05, 0.04, 0.025, 0.01])
def test_a_gap_stays_a_gap(step):
    t = clock(step, 400)
    record = line(t[(t < 1.0) | (t > 1.42)])
    before, after = record.t[record.t < 1.2].max(), record.t[record.t > 1.2].min()
    even = resample(record, 0.05)
    lost = np.isnan(even.y)
    hole = lost[:, 0]
    np.testing.assert_array_equal(lost, np.column_stack([hole] * 6))
    strictly_inside = np.logical_and(even.t > before + 1e-7, even.t < after - 1e-7)
    near = np.logical_and(even.t > before - 0.025, even.t < after + 0.025)
    assert strictly_inside.sum() >= 7
    assert hole[strictly_inside].all()
    assert not hole[~near].any()


def test_one_late_sample_is_no_gap_and_two_steps_are():
    t = clock(0.04, 50)
    late = t.copy()
    late[10] += 0.03  # 0.07 s after its neighbour: within 1.5 * 0.05 s
    assert not np.isnan(resample(line(late), 0.05).y).any()
    assert np.isnan(resample(line(np.delete(t, 11)), 0.05).y).any()


@pytest.mark.parametrize("step", [0.04, 0.01])
def test_a_missing_sample_spoils_its_channel_in_the_rows_that_need_it_and_no_other(step):
    record = line(clock(step, 500))
    y = record.y.copy()
    missing = round(1.02 / step)
    y[missing, 2] = np.nan
    even = resample(Recording(record.t, y), 0.05)
    lost = np.isnan(even.y)
    assert not np.delete(lost, 2, axis=1).any()
    assert 1 <= lost[:, 2].sum() <= 2
    assert (np.abs(even.t[lost[:, 2]] - record.t[missing]) < 0.025 + step).all()


@settings(deadline=None)
@given(hz=st.floats(0.1, 3.0), phase=st.floats(0.0, 6.3))
def test_25_to_20_hz_keeps_a_slow_sine_within_the_bound_of_straight_lines(hz, phase):
    t = clock(0.04, 500)
    record = Recording(t, np.sin(2 * np.pi * hz * t + phase)[:, None] * np.ones(6))
    even = resample(record, 0.05)
    error = np.abs(even.y[:, 0] - np.sin(2 * np.pi * hz * even.t + phase)).max()
    assert error <= (2 * np.pi * hz * 0.04) ** 2 / 8 + 1e-9


@pytest.mark.parametrize("hz", [0.5, 2.0, 5.0])
def test_averaging_scales_a_sine_by_sinc_without_delay(hz):
    even = resample(sine(clock(0.001, 5001), hz), 0.05)
    expected = np.sinc(hz * 0.05) * np.sin(2 * np.pi * hz * even.t)
    error = np.abs(even.y[1:-1, 0] - expected[1:-1]).max()
    assert error <= (2 * np.pi * hz * 0.001) ** 2 / 8


def test_averaging_removes_what_would_alias():
    t = clock(0.002, 5001)
    even = resample(sine(t, 20.0), 0.05)  # sampled at 20 Hz it would read as a constant
    assert np.abs(even.y[1:-1]).max() < 0.01


def test_averages_equal_brute_force_quadrature():
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.008, 0.02, 300))
    record = Recording(t, rng.normal(size=(300, 6)))
    even = resample(record, 0.05)
    fine = (np.arange(20000) + 0.5) / 20000 - 0.5
    for k in (1, 17, len(even.t) - 2):
        window = even.t[k] + 0.05 * fine
        means = [np.interp(window, t, channel).mean() for channel in record.y.T]
        np.testing.assert_allclose(even.y[k], means, atol=1e-5)


def test_one_constant_hour_stays_that_constant():
    record = Recording(clock(0.01, 360_000), np.full((360_000, 6), 0.1))
    np.testing.assert_allclose(resample(record, 0.05).y, 0.1, rtol=1e-11)


def test_a_recording_too_slow_for_the_monitor_is_refused_with_numbers():
    record = line(clock(0.1, 50))
    with pytest.raises(TelemetryError, match=r"every 0\.1 s; .* step of 0\.05 s .* every 0\.075 s"):
        resample(record, 0.05)
    assert len(resample(record, 0.0667).t) > 50


def test_a_clock_that_jumps_is_refused_before_it_fills_the_memory():
    record = line(np.append(clock(0.05, 20), 1.7e9))
    with pytest.raises(TelemetryError, match=r"largest step is 1\.7e\+09 s after t=0\.95 s"):
        resample(record, 0.05)
    assert MAX_ROWS * 0.05 > 24 * 3600


def test_a_clock_since_1970_is_as_good_as_any():
    t = np.array([float(f"1760000000.{hundredths:02d}") for hundredths in range(3, 98, 5)])
    even = resample(line(t), 0.05)
    assert even.y.shape == (19, 6)
    assert even.notes == ()


@pytest.mark.parametrize("step", [0.04, 0.01])
def test_heading_through_north_does_not_swing_round(step):
    t = clock(step, 200)
    heading = np.mod(3.0 + 2.0 * t, 2 * np.pi)
    heading[[10, 120]] = np.nan
    record = Recording(t, np.zeros((200, 6)), attitude={"psi": heading})
    even = resample(record, 0.05)
    psi = even.attitude["psi"]
    known = np.isfinite(psi)
    assert known.sum() >= len(psi) - 4
    turns = (psi[known] - 3.0 - 2.0 * even.t[known]) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_columns_and_earlier_notes_are_kept():
    t = clock(0.04, 10)
    record = Recording(t, np.zeros((10, 6)), columns={"p": "p_degps"}, notes=("First.",))
    even = resample(record, 0.05)
    assert even.columns == record.columns
    assert even.notes[0] == "First."
    assert "25 Hz to 20 Hz by straight lines" in even.notes[1]
    assert "look up to 0.04 s ahead" in even.notes[1]


def test_the_flown_doublet_keeps_its_peak_from_25_to_20_hz():
    path = RECORDS / "attas_rud1.csv"
    if not path.exists():
        pytest.skip(f"the flight records are not in {RECORDS}")
    record = read(path)
    even = resample(record, 0.05)
    assert even.y.shape == (601, 6)
    peak, flown = np.abs(even.y[:, 3]).max(), np.abs(record.y[:, 3]).max()
    assert 0.98 * flown < peak <= flown
