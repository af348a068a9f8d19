from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from core.simulation.maneuver import (
    MANEUVERS,
    BankToBank,
    Doublet,
    FrequencySweep,
    Maneuver,
    Multistep3211,
    OneSurface,
    Pulse,
    RollingPullOut,
    Step,
    Steps,
    Table,
    WindUpTurn,
)

DT = 0.05
AILERON, RUDDER = 0, 1


def flown_deg(maneuver: Maneuver, dt: float = DT) -> np.ndarray:
    """The planned commands (n_samples, 2) [deg]."""
    return np.rad2deg(maneuver.pilot(dt, 1, np.random.default_rng(0))[0])


def runs(command: np.ndarray) -> list[tuple[float, int]]:
    """Levels other than trim, with the number of samples of each."""
    edges = np.flatnonzero(np.diff(command, prepend=np.nan, append=np.nan) != 0)
    lengths = np.diff(edges)
    return [
        (round(float(command[i]), 9), int(n))
        for i, n in zip(edges[:-1], lengths, strict=True)
        if command[i]
    ]


@pytest.mark.parametrize("maneuver", MANEUVERS.values(), ids=MANEUVERS)
class TestEveryManeuver:
    def test_it_starts_at_trim_and_moves_after_the_lead_in(self, maneuver):
        pilot = maneuver.pilot(DT, 4, np.random.default_rng(0))
        assert pilot.shape == (1, maneuver.n_samples(DT), maneuver.n_surfaces)
        assert pilot.dtype == np.float64
        assert pilot.flags.c_contiguous
        assert np.isfinite(pilot).all()
        assert not pilot[:, :10].any()  # t < lead_in_s = 0.5 s
        assert pilot[:, 10:12].any()

    def test_its_amplitude_is_reached_and_never_exceeded(self, maneuver):
        peak = np.abs(flown_deg(maneuver, 0.005)).max()
        planned = (
            max(maneuver.delta_r_deg)
            if isinstance(maneuver, Table)
            else abs(maneuver.amplitude_deg)
        )
        assert 0.999 * planned <= peak <= planned * (1 + 1e-12)

    def test_a_negative_amplitude_is_the_other_direction(self, maneuver):
        if isinstance(maneuver, WindUpTurn | RollingPullOut):
            with pytest.raises(ValueError, match=r"amplitude_deg=5.0 .* pulls"):
                maneuver.with_peak(-maneuver.peak_deg)
            return
        if isinstance(maneuver, Table):
            turned = replace(
                maneuver,
                delta_a_deg=tuple(-x for x in maneuver.delta_a_deg),
                delta_r_deg=tuple(-x for x in maneuver.delta_r_deg),
            )
        else:
            turned = replace(maneuver, amplitude_deg=-maneuver.amplitude_deg)
        assert (flown_deg(turned) == -flown_deg(maneuver)).all()

    def test_jitter_depends_only_on_the_generator(self, maneuver):
        shaky = replace(maneuver, timing_jitter_s=0.1, amplitude_jitter=0.1)
        first, second = (shaky.pilot(DT, 6, np.random.default_rng(1)) for _ in range(2))
        assert first.shape == (6, maneuver.n_samples(DT), maneuver.n_surfaces)
        assert np.isfinite(first).all()
        assert (first == second).all()
        assert len(np.unique(first, axis=0)) == 6

    def test_vanishing_jitter_is_the_plan(self, maneuver):
        shaky = replace(maneuver, timing_jitter_s=1e-15, amplitude_jitter=1e-15)
        plan = np.deg2rad(flown_deg(maneuver))
        np.testing.assert_allclose(
            shaky.pilot(DT, 3, np.random.default_rng(2)), np.stack([plan] * 3), atol=1e-12
        )

    def test_a_build_up_flies_each_step_as_often(self, maneuver):
        shares, n = (0.5, 1.0, 1.5), 600
        planned = maneuver.pilot(DT, 1, np.random.default_rng(3))
        stepped = replace(maneuver, build_up=shares).pilot(DT, n, np.random.default_rng(3))
        flown = np.abs(stepped).max(axis=(1, 2)) / np.abs(planned).max()
        counts = [np.isclose(flown, share).sum() for share in shares]
        assert sum(counts) == n
        assert min(counts) > 150
        np.testing.assert_allclose(stepped, flown[:, None, None] * planned)

    def test_amplitude_jitter_scales_the_plan(self, maneuver):
        pilot = replace(maneuver, amplitude_jitter=0.1).pilot(DT, 5, np.random.default_rng(3))
        factors = 1 + 0.1 * np.random.default_rng(3).standard_normal(5)
        plan = np.deg2rad(flown_deg(maneuver))
        np.testing.assert_allclose(pilot, factors[:, None, None] * plan, rtol=1e-12, atol=1e-15)

    def test_zero_rollouts_are_an_empty_batch(self, maneuver):
        shaky = replace(maneuver, timing_jitter_s=0.1)
        shape = 0, maneuver.n_samples(DT), maneuver.n_surfaces
        assert shaky.pilot(DT, 0, np.random.default_rng(4)).shape == shape

    def test_it_survives_json(self, maneuver):
        adapter = TypeAdapter(type(maneuver))
        assert adapter.validate_json(adapter.dump_json(maneuver)) == maneuver
        properties = adapter.json_schema()["properties"]
        assert {"duration_s", "lead_in_s", "pedal_lag_s", "timing_jitter_s"} <= properties.keys()

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            ("duration_s", -1.0),
            ("duration_s", 0.0),
            ("duration_s", float("inf")),
            ("lead_in_s", -0.1),
            ("lead_in_s", 10.0),
            ("pedal_lag_s", float("nan")),
            ("timing_jitter_s", -0.1),
            ("amplitude_jitter", -0.1),
            ("build_up", (1.0, 0.0)),
            ("build_up", (-0.5,)),
        ],
    )
    def test_an_impossible_number_is_refused_by_name(self, maneuver, field, value):
        with pytest.raises(ValueError, match=f"{field}.*give"):
            replace(maneuver, **{field: value})


def test_the_papers_doublet_is_a_second_each_way_from_half_a_second():
    command = flown_deg(Doublet(amplitude_deg=5.0))[:, RUDDER]
    expected = np.repeat([0.0, 5.0, -5.0, 0.0], [10, 20, 20, 71])
    np.testing.assert_allclose(command, expected, rtol=1e-15)


@given(
    half=st.integers(1, 40),
    lead_in=st.integers(0, 30),
    dt=st.sampled_from([0.01, 0.02, 0.025, 0.05, 0.1, 1 / 30]),
)
def test_a_doublets_integral_is_zero_and_its_edges_fall_on_their_samples(half, lead_in, dt):
    steps = lead_in + 2 * half + 3
    doublet = Doublet(duration_s=steps * dt, lead_in_s=lead_in * dt, half_s=half * dt)
    command = flown_deg(doublet, dt)[:, RUDDER]
    np.testing.assert_allclose(
        command, np.repeat([0.0, 5.0, -5.0, 0.0], [lead_in, half, half, 4]), rtol=1e-15
    )


@pytest.mark.parametrize(
    ("maneuver", "expected"),
    [
        (Multistep3211(unit_s=0.5), [(5, 30), (-5, 20), (5, 10), (-5, 10)]),
        (Pulse(width_s=0.4), [(5, 8)]),
        (Step(), [(5, 111)]),
        (BankToBank(roll_s=0.8, hold_s=0.5), [(5, 16), (-5, 32), (5, 16)]),
        (BankToBank(roll_s=0.8, hold_s=0.0), [(5, 16), (-5, 32), (5, 16)]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_levels_last_as_planned(maneuver, expected):
    command = flown_deg(maneuver)
    column = AILERON if isinstance(maneuver, BankToBank) else RUDDER
    assert runs(command[:, column]) == expected
    assert not command[:, 1 - column].any()


@pytest.mark.parametrize(
    "maneuver",
    [m for m in MANEUVERS.values() if isinstance(m, OneSurface)],
    ids=lambda m: type(m).__name__,
)
def test_the_surface_chooses_the_column(maneuver):
    aileron, rudder = (flown_deg(replace(maneuver, surface=s)) for s in ("aileron", "rudder"))
    assert (aileron == rudder[:, ::-1]).all()
    assert not rudder[:, AILERON].any()
    assert rudder[:, RUDDER].any()


@pytest.mark.parametrize("maneuver", [m for m in MANEUVERS.values() if isinstance(m, Steps)])
def test_levels_match_segments(maneuver):
    assert len(maneuver.levels) == len(maneuver.segments_s)


def test_timing_jitter_scatters_start_and_segments_independently():
    n, dt = 4000, 0.01
    pilot = Doublet(timing_jitter_s=0.1).pilot(dt, n, np.random.default_rng(5))[..., RUDDER]
    start = (pilot != 0).argmax(axis=1) * dt
    first, second = (pilot > 0).sum(axis=1) * dt, (pilot < 0).sum(axis=1) * dt
    times = np.stack((start, first, second))
    # Sampling at dt rounds a start up by half a step on average; five standard errors of 0.0016 s.
    np.testing.assert_allclose(times.mean(axis=1), [0.505, 1.0, 1.0], atol=0.008)
    np.testing.assert_allclose(times.std(axis=1), 0.1, atol=0.006)
    assert np.abs(np.corrcoef(times) - np.eye(3)).max() < 0.08


def test_a_jittered_start_is_never_before_zero():
    doublet = Doublet(lead_in_s=0.05, timing_jitter_s=0.5)
    pilot = doublet.pilot(DT, 500, np.random.default_rng(6))[..., RUDDER]
    scatter = 0.5 * np.random.default_rng(6).standard_normal((500, 3))
    early = scatter[:, 0] < -0.05
    first = np.maximum(1.0 + scatter[:, 1], 0.0)
    assert early.any()
    held = np.maximum(np.ceil(first / DT - 1e-6), 0)
    np.testing.assert_array_equal((pilot[early] > 0).sum(axis=1), np.minimum(held, 121)[early])


def test_a_segment_of_zero_length_stays_out_under_jitter():
    flown = BankToBank(hold_s=0.0, timing_jitter_s=0.2).pilot(DT, 50, np.random.default_rng(7))
    for command in flown[..., AILERON]:
        inside = command[np.flatnonzero(command)[0] : np.flatnonzero(command)[-1] + 1]
        assert inside.all()


def test_without_jitter_no_random_number_is_drawn():
    rng = np.random.default_rng(8)
    Doublet().pilot(DT, 3, rng)
    assert rng.random() == np.random.default_rng(8).random()


@pytest.mark.parametrize("ends", [(0.2, 2.0), (2.0, 0.2), (1.0, 1.0)])
@pytest.mark.parametrize("spacing", ["log", "linear"])
def test_a_sweeps_frequency_runs_from_start_to_end(spacing, ends):
    start, end = ends
    sweep = FrequencySweep(start_hz=start, end_hz=end, sweep_s=5.0, spacing=spacing)
    dt = 1e-3
    command = flown_deg(sweep, dt)[:, RUDDER] / 5.0
    t = np.arange(6001) * dt - 0.5
    during = (t >= -1e-9) & (t < 5.0 - 1e-9)
    part = t[during] / 5.0
    wanted = start * (end / start) ** part if spacing == "log" else start + (end - start) * part
    # The phase is the frequency's integral, here by the trapezoid rule, error below 1e-5 rad.
    phase = 2 * pi * np.concatenate(([0.0], np.cumsum((wanted[1:] + wanted[:-1]) / 2 * dt)))
    np.testing.assert_allclose(command[during], np.sin(phase), atol=2e-5)
    assert not command[~during].any()


def test_a_stretched_sweep_keeps_its_frequencies():
    sweep = FrequencySweep(start_hz=0.5, end_hz=2.0, spacing="linear")
    elapsed = np.arange(5001, dtype=np.float64)[np.newaxis] * 1e-3
    whole, half = (sweep.shape(elapsed, np.array([[s]]))[0] for s in (5.0, 2.5))
    # Cycles are mean frequency times duration: 6.25 and 3.125, so 13 and 7 half waves have begun.
    crossings = [np.count_nonzero(np.diff(np.sign(x[x != 0]))) for x in (whole, half)]
    assert crossings == [12, 6]
    assert not half[2500:].any()


def test_a_sweep_too_fast_for_dt_is_refused():
    with pytest.raises(ValueError, match=r"below 10 Hz.*12.0 Hz: give"):
        FrequencySweep(end_hz=12.0).pilot(DT, 1, np.random.default_rng(0))


def table(**changes: Any) -> Table:
    given: dict[str, Any] = {
        "t_s": (0.1, 0.5, 1.0), "delta_a_deg": (1.0, 2.0, 3.0), "delta_r_deg": (4.0, 0.0, -4.0),
    }  # fmt: skip
    return Table(**(given | changes))


def test_a_held_table_keeps_each_row_until_the_next():
    command = flown_deg(table(interpolation="hold"))
    expected = np.repeat([[0, 0], [1, 4], [2, 0], [3, -4]], [12, 8, 10, 91], axis=0)
    np.testing.assert_allclose(command, expected, rtol=1e-15)


def test_a_linear_table_joins_its_rows_by_lines():
    command = flown_deg(table(interpolation="linear"))
    np.testing.assert_allclose(command[12:31, AILERON], np.r_[
        np.linspace(1, 2, 9), np.linspace(2, 3, 11)[1:]], rtol=1e-12)  # fmt: skip
    assert not command[:12].any()
    np.testing.assert_allclose(command[30:, RUDDER], -4.0, rtol=1e-12)


def test_jitter_stretches_a_table_as_a_whole():
    plan = table(interpolation="hold")
    elapsed = np.arange(0.0, 3.0, DT)[np.newaxis]
    stretched = plan.commands(elapsed, np.array([[2.0]]))
    np.testing.assert_array_equal(stretched, plan.commands(elapsed / 2, np.array([[1.0]])))


def test_a_table_of_one_row_is_a_step():
    row = Table(t_s=(0.0,), delta_a_deg=(0.0,), delta_r_deg=(5.0,), interpolation="hold")
    np.testing.assert_array_equal(flown_deg(row), flown_deg(Step()))
    shaky = replace(row, timing_jitter_s=0.1).pilot(DT, 4, np.random.default_rng(9))
    assert (np.diff(shaky[..., RUDDER], axis=1) != 0).sum() == 4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: table(t_s=(0.0, 0.5)), "2 times, 3 aileron and 3 rudder commands; give equally"),
        (lambda: Table(t_s=(), delta_a_deg=(), delta_r_deg=()), "0 times, .* at least one"),
        (lambda: table(t_s=(0.0, 0.5, 0.5)), r"t_s\[2\]=0.5 follows 0.5; the times must increase"),
        (lambda: table(t_s=(-0.5, 0.5, 0.6)), "t_s is -0.5; give a finite number, zero or more"),
        (lambda: table(delta_a_deg=(1.0, float("nan"), 1.0)), "delta_a_deg is nan; give"),
        (lambda: table(interpolation="cubic"), "interpolation='cubic' was given: choose hold"),
        (lambda: Doublet(amplitude_deg=float("nan")), "amplitude_deg is nan; give a finite number"),
        (lambda: Doublet(half_s=-1.0), "half_s is -1.0; give a finite number, zero or more"),
        (
            lambda: Doublet(surface="flap"),  # pyright: ignore[reportArgumentType]
            "surface='flap' was given: choose aileron, rudder, elevator",
        ),
        (lambda: FrequencySweep(start_hz=0.0), "start_hz=0.0 was given: it must be positive"),
        (
            lambda: FrequencySweep(spacing="cubic"),  # pyright: ignore[reportArgumentType]
            "spacing='cubic' was given: choose log or linear",
        ),
        (lambda: Doublet().n_samples(0.07), "duration_s=6.0 is 85.7143 steps .* duration_s=6.02"),
        (lambda: Doublet().n_samples(0.0), "dt=0.0 s; give a finite time step above zero"),
        (lambda: Doublet().n_samples(float("nan")), "dt=nan s"),
    ],
)
def test_an_impossible_plan_is_refused_in_one_sentence(make, message):
    with pytest.raises(ValueError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
