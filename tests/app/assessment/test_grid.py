"""Live samples on the monitor's times: bits, gaps, order, clocks, and nothing of the future."""

import re

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.assessment.grid import CausalGrid, Sample
from core.channels import N_CHANNELS
from core.types import Array

DT = 0.02
DELAY = 1.5 * DT


def at(t: float) -> Array:
    """A smooth flight, a channel each."""
    return np.sin((1.0 + np.arange(N_CHANNELS)) * t)


def flown(times: npt.ArrayLike, arrivals: npt.ArrayLike | None = None) -> tuple:
    resampler = CausalGrid(DT, DELAY)
    out: list[Sample] = []
    came = np.asarray(times if arrivals is None else arrivals)
    for t, arrived in zip(np.asarray(times), came, strict=True):
        out += resampler.push(float(arrived), Sample(float(t), at(float(t))))
    return out, resampler


def test_a_source_on_the_grid_passes_bit_for_bit_and_at_once() -> None:
    resampler = CausalGrid(DT, DELAY)
    for k in range(100):
        t = 1e6 + k * DT
        (out,) = resampler.push(t, Sample(t, at(t)))
        assert out.t == t
        assert np.array_equal(out.y, at(t))
    assert resampler.deadline is None


@pytest.mark.parametrize("rate", [1000.0, 200.0, 100.0, 60.0, 47.0, 40.0])
def test_another_rate_comes_on_the_grid_within_the_delay_and_close_to_the_flight(
    rate: float,
) -> None:
    times = np.arange(int(3 * rate)) / rate
    resampler = CausalGrid(DT, DELAY)
    out = []
    for t in times:
        for sample in resampler.push(float(t), Sample(float(t), at(float(t)))):
            assert t - sample.t <= DELAY + 1e-9
            out.append(sample)
    assert np.allclose(np.diff([s.t for s in out]), DT, atol=1e-9)
    assert len(out) >= 3 / DT - 3
    for sample in out:
        assert np.abs(sample.y - at(sample.t)).max() < 0.01


def test_what_would_alias_is_averaged_away_from_a_faster_source() -> None:
    times = np.arange(3000) / 1000.0
    resampler, out = CausalGrid(DT, DELAY), []
    for t in times:
        out += resampler.push(float(t), Sample(float(t), np.full(6, np.sin(2 * np.pi * 49.0 * t))))
    assert np.abs([s.y for s in out[5:]]).max() < 0.03


def test_out_of_order_within_the_delay_gives_the_bits_of_the_order() -> None:
    times = np.arange(50) * DT
    swapped = times.copy()
    swapped[[20, 21]] = swapped[[21, 20]]
    arrivals = times.copy()
    arrivals[20], arrivals[21] = times[21], times[21] + 0.005
    out, resampler = flown(swapped, arrivals)
    assert np.array_equal([s.y for s in out], [at(t) for t in times])
    assert resampler.counts.out_of_order == 1
    assert resampler.counts.missing == 0


def test_a_missing_sample_is_a_gap_after_the_delay_and_one_too_late_is_left_out() -> None:
    resampler = CausalGrid(DT, DELAY)
    for k in (0, 1, 3):
        resampler.push(k * DT, Sample(k * DT, at(k * DT)))
    deadline = resampler.deadline
    assert deadline is not None
    assert deadline == pytest.approx(3 * DT + DELAY - DT)
    assert not resampler.advance(deadline - 1e-6)
    (after,) = resampler.advance(deadline)
    assert after.t == 3 * DT
    assert not resampler.push(0.1, Sample(2 * DT, at(2 * DT)))
    assert (resampler.counts.missing, resampler.counts.late) == (1, 1)


def test_a_repeated_sample_is_left_out_and_counted() -> None:
    times = np.repeat(np.arange(20) * DT, 2)
    out, resampler = flown(times, np.arange(40) * DT / 2)
    assert len(out) == 20
    assert resampler.counts.repeated == 20


def test_a_clock_that_is_set_back_or_ahead_is_a_step_and_the_flight_goes_on() -> None:
    arrivals = np.arange(200) * DT
    times = arrivals.copy()
    times[100:] -= 3600.0
    out, resampler = flown(times, arrivals)
    t = np.array([s.t for s in out])
    assert resampler.counts.clock_steps == 1
    assert (np.diff(t) > 0).all()
    assert t[-1] == pytest.approx(arrivals[-1], abs=0.05)
    times = arrivals.copy()
    times[100:] += 3600.0
    out, resampler = flown(times, arrivals)
    assert resampler.counts.clock_steps == 1
    assert out[-1].t == pytest.approx(arrivals[-1], abs=0.05)


def test_a_clock_that_is_set_back_among_times_that_came_is_a_step_not_a_repetition() -> None:
    resampler, out = CausalGrid(DT, DELAY), []
    arrivals = np.arange(200) * DT
    for k, arrived in enumerate(arrivals.tolist()):
        t = arrived if k < 100 else arrivals[k - 50]
        out += resampler.push(arrived, Sample(float(t), at(arrived)))
    assert resampler.counts.clock_steps == 1
    assert resampler.counts.repeated == 0
    assert out[-1].t == pytest.approx(arrivals[-1], abs=0.05)


def test_one_wild_time_is_not_believed() -> None:
    arrivals = np.arange(60) * DT
    times = arrivals.copy()
    times[30] = 1e9
    out, resampler = flown(times, arrivals)
    assert resampler.counts.implausible_times == 1
    assert resampler.counts.clock_steps == 0
    assert out[-1].t == arrivals[-1]


def test_times_too_coarse_for_the_grid_begin_no_flight() -> None:
    """Else a grid of 20 ms never got past one of nanoseconds since 1970."""
    resampler = CausalGrid(DT, DELAY)
    assert resampler.push(3.0, Sample(1.7e18, at(0.0))) == []
    assert resampler.pushed_at == (3.0, False)
    assert resampler.counts.implausible_times == 1
    (first,) = resampler.push(3.5, Sample(1.0, at(1.0)))
    assert first.t == 1.0


def test_a_source_that_is_too_slow_says_so_instead_of_a_number() -> None:
    out, _ = flown(np.arange(40) * 2.0 * DT)
    assert np.isnan(out[-1].y).all()
    assert "each 0.04 s, the monitor needs a sample each 0.02 s" in out[-1].reason


def test_late_samples_are_told_apart_from_a_source_that_is_too_slow() -> None:
    times = np.arange(80) * DT
    arrivals = times + np.where(np.arange(80) % 4 == 0, 0.0, 8.0 * DT)
    order = np.argsort(arrivals, kind="stable")
    out, resampler = flown(times[order], arrivals[order])
    assert np.isnan(out[-1].y).all()
    assert re.match(r"\d+ of the last \d+ samples came too late to be used", out[-1].reason)
    assert resampler.counts.late > 40


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2])
def test_a_source_that_swaps_its_samples_in_pairs_is_not_called_slow(delay: float) -> None:
    grid, reasons = CausalGrid(DT, delay, 6), set[str]()
    for n in range(60):
        sample = Sample((n ^ 1) * DT, np.zeros(6))
        reasons |= {settled.reason for settled in grid.push(n * DT, sample)}
    assert any(reasons)
    assert not any("send at" in reason for reason in reasons)


def test_a_link_that_was_out_gives_a_gap_and_no_step() -> None:
    times = np.concatenate([np.arange(50), np.arange(550, 600)]) * DT
    out, resampler = flown(times)
    assert np.array_equal([s.t for s in out], times)
    assert resampler.counts.clock_steps == 0


def arrivals_of(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Times and arrivals as a network makes them: jitter, loss, repeats, disorder, steps."""
    rate = draw(st.sampled_from([1000.0, 100.0, 60.0, 50.0, 40.0]))
    n = draw(st.integers(5, 60))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    t = np.arange(n) / rate
    if draw(st.booleans()):
        t[n // 2 :] += draw(st.sampled_from([-100.0, 100.0, 2.0]))
    arrived = np.arange(n) / rate + rng.exponential(draw(st.sampled_from([0.0, 0.01, 0.1])), n)
    kept = rng.random(n) > draw(st.sampled_from([0.0, 0.2]))
    pairs = [(a, b) for a, b in zip(arrived[kept], t[kept], strict=True)]
    pairs += [pair for pair in pairs if rng.random() < 0.1]
    return sorted((float(a), float(b)) for a, b in pairs)


@given(st.composite(arrivals_of)())
@settings(max_examples=60, deadline=None)
def test_looking_at_the_clock_in_between_changes_no_bit(pairs: list[tuple[float, float]]) -> None:
    end = max((a for a, _ in pairs), default=0.0) + 1.0

    def run(looks: bool) -> list[Sample]:
        resampler, out, now = CausalGrid(DT, DELAY), [], 0.0
        for arrived, t in pairs:
            while looks and now < arrived:
                out += resampler.advance(now)
                now += 0.003
            out += resampler.push(arrived, Sample(t, at(t)))
        return out + resampler.advance(end)

    plain, looked = run(False), run(True)
    assert [s.t for s in plain] == [s.t for s in looked]
    assert all(np.array_equal(a.y, b.y, equal_nan=True) for a, b in zip(plain, looked, strict=True))
    assert (np.diff([s.t for s in plain]) > 0).all()


@given(st.composite(arrivals_of)(), st.integers(1, 40))
@settings(max_examples=60, deadline=None)
def test_what_comes_later_changes_nothing_that_was_said(
    pairs: list[tuple[float, float]], cut: int
) -> None:
    def run(some: list[tuple[float, float]]) -> list[Sample]:
        resampler, out = CausalGrid(DT, DELAY), []
        for arrived, t in some:
            out += resampler.push(arrived, Sample(t, at(t)))
        return out

    early, whole = run(pairs[:cut]), run(pairs)
    assert [s.t for s in early] == [s.t for s in whole[: len(early)]]
    assert all(
        np.array_equal(a.y, b.y, equal_nan=True)
        for a, b in zip(early, whole[: len(early)], strict=True)
    )
