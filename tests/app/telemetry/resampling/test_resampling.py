"""Resample onto one grid: keep the signal, remove aliases, invent nothing."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.telemetry.recording import Recording, TelemetryError
from app.telemetry.resampling.low_pass import HALF_WIDTH, PASS, STOP, low_passed
from app.telemetry.resampling.resampling import MAX_ROWS, on_grid
from app.telemetry.resampling.segments import EVEN
from app.telemetry.traces import Trace, Traces
from core.channels import KEYS
from core.types import Array
from tests.support.places import RECORDS
from tests.support.repetition import examples

SLOPES = np.array([1.0, -2.0, 0.0, 0.5, 3.0, -0.1])
OFFSETS = np.array([0.1, 0.2, 0.3, -0.4, 0.0, 7.0])


def clock(step: float, n: int, start: float = 0.0) -> Array:
    return start + step * np.arange(n, dtype=np.float64)


def line(t: Array) -> Recording:
    return Recording(t, OFFSETS + SLOPES * t[:, None])


def traces(t: Array, *values: Array, **more: Trace) -> Traces:
    """As many of the six channels as there are values, on one clock; more on their own."""
    return Traces(
        {key: Trace(t, x, source=f"col_{key}") for key, x in zip(KEYS, values, strict=False)} | more
    )


def resampled(record: Recording, dt: float) -> Recording:
    """A recording whose channels share one clock, on the grid of another step."""
    channels = dict(zip(KEYS, record.y.T, strict=True)) | record.attitude
    return on_grid(Traces({key: Trace(record.t, x) for key, x in channels.items()}), dt)


def sines(t: Array, highest: float) -> Array:
    """Four sines of together 1 up to a frequency [Hz]."""
    shares = np.array([0.13, 0.41, 0.78, 1.0])
    return 0.25 * np.sin(2 * np.pi * highest * shares * t[:, None] + [0.3, 2.0, 1.0, 5.0]).sum(1)


# --- what survives


@settings(max_examples=examples(60))
@given(
    step=st.floats(0.005, 0.062),  # with the jitter no step is a gap
    n=st.integers(2, 200),
    origin=st.floats(-1e3, 1e4),
    jitter=st.floats(0.0, 0.2),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_line_stays_a_line(step, n, origin, jitter, seed):
    uneven = jitter * np.random.default_rng(seed).uniform(-0.5, 0.5, n)
    record = line(origin + step * (np.arange(n) + uneven))
    assume(record.t[-1] - record.t[0] > 0.05)
    even = resampled(record, 0.05)
    np.testing.assert_allclose(even.t, record.t[0] + 0.05 * np.arange(len(even.t)), atol=1e-9)
    assert record.t[-1] - 0.05 < even.t[-1] + 1e-7
    taken_as_even = EVEN * step + 1e-6 * 0.05
    np.testing.assert_allclose(even.y, line(even.t).y, rtol=0, atol=1.01 * 3.0 * taken_as_even)


@pytest.mark.parametrize("stride", [0.7, 1.0, 1.25, 5 / 3, 5.0, 7.31, 50.0])
@pytest.mark.parametrize("first", [0.0, 0.4])
def test_constants_and_lines_pass_the_filter_to_rounding(stride, first):
    n = int((2000 - 1 - first) / stride) + 1
    np.testing.assert_allclose(low_passed(np.full(2000, 0.1), first, stride, n), 0.1, rtol=1e-14)
    places = first + stride * np.arange(n)
    rows = low_passed(3.0 - 0.5 * clock(1.0, 2000), first, stride, n)
    np.testing.assert_allclose(rows, 3.0 - 0.5 * places, rtol=0, atol=1e-11)


@pytest.mark.parametrize("step", [0.001, 0.01, 1 / 60, 0.04, 0.05, 0.0625, 0.07])
@pytest.mark.parametrize("origin", [0.0, 1.76e9 + 0.013])
def test_a_band_limited_signal_survives(step, origin):
    dt = 0.05
    slower = max(dt, step)
    t = clock(step, int(40 / step))
    other = clock(slower, int(39 / slower), 0.021)  # anchors the grid off the samples of the first
    result = on_grid(
        traces(origin + t, sines(t, PASS / slower), r=Trace(origin + other, 0 * other)), dt
    )
    at = result.t - origin
    inside = (at > HALF_WIDTH * slower) & (at < t[-1] - HALF_WIDTH * slower)
    assert inside.sum() > 500
    error = np.abs(result.y[:, 0] - sines(at, PASS / slower))[inside]
    assert error.max() < 1e-3
    assert np.abs(result.y[:, 0] - sines(at, PASS / slower))[~np.isnan(result.y[:, 0])].max() < 0.5


@settings(max_examples=examples(40))
@given(
    tone=st.floats(STOP / 0.05, 50.0 - STOP / 0.05),
    phase=st.floats(0.0, 6.3),
    drift=st.sampled_from([0.0, 1e-5]),
)
def test_aliases_are_removed(tone, phase, drift):
    t = clock(0.01 * (1.0 + drift), 1000)
    result = on_grid(traces(t, np.sin(2 * np.pi * tone * t + phase)), 0.05)
    assert np.abs(result.y[HALF_WIDTH:-HALF_WIDTH, 0]).max() < 1e-3


def test_tabulated_kernels_agree_with_exact_ones():
    x = np.random.default_rng(5).normal(size=3000)
    exact = low_passed(x, 0.3, 5.0, 590)
    table = low_passed(x, 0.3, 5.0 + 2e-7, 590)
    np.testing.assert_allclose(table, exact, rtol=0, atol=5e-5)


def test_a_row_equals_the_windowed_sinc_summed_by_hand():
    x = np.random.default_rng(6).normal(size=400)
    row = low_passed(x, 200.25, 4.0, 1)[0]
    distance = (np.arange(400) - 200.25) / 4.0
    inside = np.abs(distance) < HALF_WIDTH
    window = np.i0(6.247 * np.sqrt(1 - (distance[inside] / HALF_WIDTH) ** 2))
    weights = np.sinc(distance[inside]) * window
    assert row == pytest.approx(x[inside] @ weights / weights.sum(), abs=1e-3)


def test_uneven_clocks_keep_their_times():
    rng = np.random.default_rng(3)
    t = clock(0.01, 3000) + rng.uniform(-0.003, 0.003, 3000)
    result = on_grid(traces(t, sines(t, 4.0)), 0.05)
    inside = slice(HALF_WIDTH, -HALF_WIDTH)
    assert np.abs(result.y[inside, 0] - sines(result.t, 4.0)[inside]).max() < 2e-3
    as_if_even = np.interp(result.t, clock(0.01, 3000), sines(t, 4.0))
    assert np.abs(as_if_even - sines(result.t, 4.0)).max() > 0.02
    assert "from an uneven clock by local cubics" in result.notes[0]


def test_a_cubic_is_never_drawn_through_two_samples_that_almost_coincide():
    t = np.sort(np.append(clock(0.05, 100, 0.01), 2.5101))
    x = np.where(np.arange(101) % 2, 1.0, -1.0)
    result = on_grid(traces(t, x, x, x, x, x, x), 0.05)
    assert np.abs(result.y).max() < 1.6


def test_one_constant_hour_stays_that_constant():
    record = Recording(clock(0.01, 360_000), np.full((360_000, 6), 0.1))
    np.testing.assert_allclose(resampled(record, 0.05).y, 0.1, rtol=1e-14)


@pytest.mark.parametrize("shift", [-3.0, 17.3, 1e5, 1.7e9])
def test_a_later_clock_changes_nothing_else(shift):
    t = np.delete(clock(0.01, 3000), np.s_[1000:1100])
    x = np.random.default_rng(1).normal(size=len(t))
    early, late = on_grid(traces(t, x), 0.05), on_grid(traces(t + shift, x), 0.05)
    np.testing.assert_allclose(late.t - shift, early.t, atol=1e-6)
    np.testing.assert_allclose(late.y, early.y, atol=2e-3 if shift > 1e9 else 1e-5)


# --- bit for bit


@pytest.mark.parametrize(("rate_hz", "dt"), [(25, 0.04), (20, 0.05), (60, 1 / 60), (100, 0.01)])
@pytest.mark.parametrize("origin", [0.0, 3412.0, 1.76e9])
def test_a_recording_on_the_grid_is_returned_as_it_is(rate_hz, dt, origin):
    t = origin + np.arange(1000) / rate_hz
    record = line(t)
    psi = np.mod(t - origin, 6.28)
    result = on_grid(traces(t, *record.y.T, psi=Trace(t, psi)), dt)
    np.testing.assert_array_equal(result.t, t)
    np.testing.assert_array_equal(result.y, record.y)
    np.testing.assert_array_equal(result.attitude["psi"], psi)
    assert result.notes == ()


def test_samples_on_the_grid_survive_lost_neighbours_bit_for_bit():
    whole = Recording(clock(0.05, 40), np.random.default_rng(2).normal(size=(40, 6)))
    rows = np.delete(np.arange(40), [5, 20, 21, 22])
    even = resampled(Recording(whole.t[rows], whole.y[rows]), 0.05)
    np.testing.assert_array_equal(even.y[rows], whole.y[rows])
    assert np.isnan(even.y[[5, 20, 21, 22]]).all()
    assert "2 gaps longer than 0.075 s left open, the longest 0.2 s" in even.notes[-1]


def test_a_channel_with_long_gaps_keeps_its_samples_on_the_grid():
    t = clock(0.05, 200)
    x = np.random.default_rng(2).normal(size=(2, 200))
    x[1, :150] = np.nan
    x[1, 170] = np.inf
    result = on_grid(traces(t, *x), 0.05)
    x[1, 170] = np.nan
    np.testing.assert_array_equal(result.y[:, :2], x.T)


# --- nothing invented


@pytest.mark.parametrize("step", [0.07, 0.05, 0.04, 0.025, 0.01])
def test_a_gap_stays_a_gap(step):
    t = clock(step, 400)
    record = line(t[(t < 1.0) | (t > 1.42)])
    before, after = record.t[record.t < 1.2].max(), record.t[record.t > 1.2].min()
    even = resampled(record, 0.05)
    lost = np.isnan(even.y)
    hole = lost[:, 0]
    np.testing.assert_array_equal(lost, np.column_stack([hole] * 6))
    inside = (even.t > before + 1e-7) & (even.t < after - 1e-7)
    assert inside.sum() >= 7
    np.testing.assert_array_equal(hole, inside)


@pytest.mark.parametrize("step", [0.01, 0.04, 0.05])
def test_nothing_beyond_a_gap_or_the_reach_of_the_filter_matters(step):
    t = np.delete(clock(step, 1200, 0.02), np.s_[600:640])
    x = np.random.default_rng(4).normal(size=len(t))
    at = clock(0.05, 40, 0.013)
    plain = on_grid(traces(t, x, p=Trace(at, 0 * at)), 0.05)
    for changed in (3, 300, 598, 600, 900):
        other = x.copy()
        other[changed] += 100.0
        touched = on_grid(traces(t, other, p=Trace(at, 0 * at)), 0.05).y[:, 0] != plain.y[:, 0]
        touched &= ~np.isnan(plain.y[:, 0])
        reach = np.abs(plain.t - t[changed]) <= HALF_WIDTH * 0.05 + 2 * step
        same_side = (plain.t < t[599] + step / 2) == (changed < 600)
        assert not touched[~(reach & same_side)].any()


@pytest.mark.parametrize("jitter", [0.0, 0.1])
@pytest.mark.parametrize("step", [0.01, 0.04, 0.05, 0.07])
def test_the_look_ahead_of_a_row_is_reported(step, jitter):
    rng = np.random.default_rng(5)
    t = clock(step, 800, 0.003) + jitter * step * rng.uniform(-1, 1, 800)
    x = rng.normal(size=len(t))
    at = clock(0.05, 40, 0.013)
    plain = on_grid(traces(t, x, p=Trace(at, 0 * at)), 0.05, ("beta",))
    early = []
    for changed in (300, 301, 302, 500):
        other = x.copy()
        other[changed] += 100.0
        row = on_grid(traces(t, other, p=Trace(at, 0 * at)), 0.05, ("beta",))
        early.append((t[changed] - plain.t[row.y[:, 0] != plain.y[:, 0]]).max())
    assert plain.look_ahead == 0.0 or 0.5 * plain.look_ahead < max(early)
    assert max(early) <= plain.look_ahead + 1e-6 + 1e-3 * step


def test_samples_as_recorded_do_not_look_ahead():
    t = clock(0.05, 50)
    assert resampled(line(t), 0.05).look_ahead == 0.0


def test_one_late_sample_is_not_a_gap_but_two_steps_are():
    t = clock(0.04, 50)
    late = t.copy()
    late[10] += 0.03  # 0.07 s after its neighbour: within 1.5 * 0.05 s
    assert not np.isnan(resampled(line(late), 0.05).y).any()
    assert np.isnan(resampled(line(np.delete(t, 11)), 0.05).y).any()


@pytest.mark.parametrize("missing", [slice(102, 103), slice(102, 140)])
@pytest.mark.parametrize("step", [0.05, 0.04, 0.01])
def test_a_missing_value_is_like_a_sample_that_was_not_taken(step, missing):
    t = clock(step, 500)
    y = np.random.default_rng(9).normal(size=(500, 6))
    y[missing, 2] = np.nan
    even = resampled(Recording(t, y), 0.05)
    known = np.isfinite(y[:, 2])
    alone = on_grid(
        traces(t, y[:, 0], y[:, 1], r=Trace(t[known], y[known, 2])),  # other keys keep the span
        0.05,
    )
    np.testing.assert_allclose(even.y[:, 2], alone.y[:, 2], rtol=0, atol=1e-12)
    lost = np.isnan(even.y)
    assert not np.delete(lost, 2, axis=1).any()
    first, last = t[missing.start - 1], t[missing.stop]
    inside = (even.t > first + 1e-7) & (even.t < last - 1e-7)
    is_gap = last - first > 0.075
    np.testing.assert_array_equal(lost[:, 2], inside & is_gap)
    assert any("r: 1 lost sample in holes" in note for note in even.notes) != is_gap


# --- mixed rates


def test_channels_of_different_rates_line_up():
    rates = {"beta": (0.01, 0.0), "p": (0.02, 0.013), "r": (0.05, 0.021), "Ny": (1 / 64, 0.001)}
    channels = {}
    for key, (step, start) in rates.items():
        t = clock(step, int(30 / step), start)
        channels[key] = Trace(t, sines(t, 4.0))
    result = on_grid(Traces(channels), 0.05)
    assert result.t[0] == 0.021  # on the samples of the slowest
    assert result.t[-1] <= 29.97 + 0.021
    middle = slice(HALF_WIDTH, -HALF_WIDTH)
    np.testing.assert_allclose(
        result.y[middle, :4], np.column_stack([sines(result.t[middle], 4.0)] * 4), atol=1e-3
    )
    np.testing.assert_array_equal(result.y[:, 2], channels["r"].values[: len(result.t)])
    assert np.isnan(result.y[:, 4:]).all()
    assert set(result.columns) == set(rates)


def test_the_grid_spans_what_all_needed_channels_have_and_the_others_are_nan_outside():
    t, brief = clock(0.05, 400), clock(0.05, 100, 5.0)
    x = np.ones(400)
    result = on_grid(
        traces(t, x, x, phi=Trace(brief, np.zeros(100)), r=Trace(t[40:300], x[40:300])), 0.05
    )
    assert (result.t[0], result.t[-1]) == (t[40], t[299])
    assert not np.isnan(result.y[:, :3]).any()
    known = np.isfinite(result.attitude["phi"])
    np.testing.assert_array_equal(known, (result.t > 4.99) & (result.t < 9.96))
    free = on_grid(traces(t, x, x, r=Trace(t[40:300], x[40:300])), 0.05, needed=("beta", "p"))
    assert (free.t[0], free.t[-1]) == (t[0], t[-1])
    assert np.isnan(free.y[:, 2]).sum() == 140


def test_channels_that_were_never_recorded_together_are_refused():
    x = np.ones(100)
    apart = traces(clock(0.05, 100), x, p=Trace(clock(0.05, 100, 60.0), x))
    with pytest.raises(TelemetryError, match=r"p starts at 60 s and beta ends at 4\.95 s"):
        on_grid(apart, 0.05)
    with pytest.raises(TelemetryError, match="none of the channels that the monitor needs"):
        on_grid(Traces({"phi": Trace(clock(0.05, 100), x)}), 0.05)


def test_a_slow_needed_channel_is_refused_and_a_slow_attitude_is_drawn():
    t, slow = clock(0.01, 1000), clock(0.5, 20)
    x = np.ones(1000)
    record = traces(t, x, x, phi=Trace(slow, 0.1 * slow), p=Trace(slow, slow))
    with pytest.raises(
        TelemetryError, match=r"p has a value every 0\.5 s, .* step of 0\.05 s .* every 0\.075 s"
    ):
        on_grid(record, 0.05)
    result = on_grid(record, 0.05, needed=("beta",))
    known = np.isfinite(result.attitude["phi"])
    np.testing.assert_allclose(result.attitude["phi"][known], 0.1 * result.t[known], atol=1e-12)
    assert any("p, phi" in n or "phi, p" in n for n in result.notes if "for display only" in n)


def test_blanks_between_values_do_not_raise_the_rate_of_a_slow_channel():
    t = clock(0.05, 400)
    x = np.ones((2, 400))
    x[1, 1::2] = np.nan
    with pytest.raises(TelemetryError, match=r"p has a value every 0\.1 s"):
        on_grid(traces(t, *x), 0.05)


def test_a_recording_too_slow_for_the_monitor_is_refused_with_numbers():
    record = line(clock(0.1, 50))
    with pytest.raises(TelemetryError, match=r"every 0\.1 s, .* step of 0\.05 s .* every 0\.075 s"):
        resampled(record, 0.05)
    assert len(resampled(record, 0.0667).t) > 50


def test_a_clock_that_jumps_is_refused_before_it_fills_the_memory():
    record = line(np.append(clock(0.05, 20), 1.7e9))
    with pytest.raises(TelemetryError, match=r"largest step is 1\.7e\+09 s after t=0\.95 s"):
        resampled(record, 0.05)
    assert MAX_ROWS * 0.05 > 24 * 3600


def test_resampling_needs_increasing_times():
    with pytest.raises(ValueError, match="repair them first"):
        on_grid(traces(np.array([0.0, 0.1, 0.05, 0.2]), np.zeros(4)), 0.05)


def test_a_clock_since_1970_is_as_good_as_any():
    t = np.array([float(f"1760000000.{hundredths:02d}") for hundredths in range(3, 98, 5)])
    even = resampled(line(t), 0.05)
    assert even.y.shape == (19, 6)
    assert even.notes == ()


@pytest.mark.parametrize("step", [0.04, 0.01])
def test_a_heading_through_north_has_no_jump(step):
    t = clock(step, 200)
    heading = np.mod(3.0 + 2.0 * t, 2 * np.pi)
    heading[[10, 120]] = np.nan
    even = resampled(Recording(t, np.zeros((200, 6)), attitude={"psi": heading}), 0.05)
    psi = even.attitude["psi"]
    known = np.isfinite(psi)
    assert known.sum() >= len(psi) - 4
    turns = (psi[known] - 3.0 - 2.0 * even.t[known]) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_sources_and_earlier_notes_are_kept():
    trace = Trace(clock(0.04, 10), np.zeros(10), source="v / V", derived=True)
    result = on_grid(Traces({"beta": trace}, ("First.",)), 0.05)
    assert (result.columns, result.derived) == ({"beta": "v / V"}, {"beta"})
    assert result.notes == (
        "First.",
        "beta: resampled from 25 Hz to 20 Hz, by a zero-phase low-pass filter that passes up to "
        "8 Hz and removes 12 Hz and above; uses samples up to 0.5 s in the future; a step "
        "appears 0.05 s early with 9 % of its height.",
    )


def test_the_flown_doublet_keeps_its_peak_from_25_to_20_hz():
    path = RECORDS / "attas_rud1.csv"
    if not path.exists():
        pytest.skip(f"the flight records are not in {RECORDS}")
    table = np.genfromtxt(path, delimiter=",", names=True)
    result = on_grid(Traces({"Ny": Trace(table["t_s"], table["ay_g"])}), 0.05)
    assert result.y.shape == (601, 6)
    peak, flown = np.nanmax(np.abs(result.y[:, 3])), np.abs(table["ay_g"]).max()
    assert 0.98 * flown < peak < 1.01 * flown
