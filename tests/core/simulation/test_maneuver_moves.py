"""Planned changes of commands: every surface that moves, as steps and ramps."""

import numpy as np
import pytest

from core.simulation.maneuver import COLUMN, MANEUVERS, FrequencySweep, Maneuver, Table, WindUpTurn

DT = 0.01
MEMBERS = [
    *(each for each in MANEUVERS.values() if not isinstance(each, FrequencySweep)),
    Table(interpolation="hold"),
    WindUpTurn(duration_s=6.0),
]


@pytest.mark.parametrize("maneuver", MEMBERS, ids=lambda each: type(each).__name__)
def test_the_moves_are_the_flown_commands(maneuver: Maneuver) -> None:
    t = np.arange(maneuver.n_samples(DT)) * DT
    flown = np.rad2deg(maneuver.pilot(DT, 1, np.random.default_rng(0))[0])
    drawn = np.zeros_like(flown)
    for surface, moves in maneuver.moves.items():
        at, value = [0.0], [0.0]
        for move in moves:
            at += [move.start, move.end + 1e-7]
            value += [value[-1], move.value]
        drawn[:, COLUMN[surface]] = np.interp(t + 2e-7, at, value)
    assert drawn == pytest.approx(flown, abs=1e-3)


def test_a_command_with_many_changes_is_summed_up() -> None:
    """Not left out: where it moves, and how far."""
    n = 100
    rows = tuple(float(k % 2) for k in range(n))
    table = Table(t_s=tuple(0.05 * k for k in range(n)), delta_a_deg=rows, delta_r_deg=(0.0,) * n)
    words = table.in_words
    assert words.startswith(f"aileron {n - 1} changes from 0.5 s")
    assert "between 0 and 1 deg" in words
    assert len(words) < 200


def test_no_value_in_words_is_a_negative_zero() -> None:
    words = [each.with_peak(-3.0).in_words for each in MANEUVERS.values()]
    assert not [each for each in words if "-0 deg" in each]


def test_a_sweep_has_its_frequencies_and_times() -> None:
    words = MANEUVERS["frequency_sweep"].in_words
    assert "rudder sine of 5 deg from 0.5 s to 5.5 s" in words
    assert "from 0.2 to 2 Hz" in words
