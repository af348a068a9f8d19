"""The stored validity matrix, and a part of it recomputed."""

import csv

import numpy as np
import pytest
from pydantic import TypeAdapter

from core.monitor import Monitor, MonitorRecipe, train
from core.simulation.published import MODELS
from tests.studies.validity_matrix import MatrixRecipe, Pair, counts_of, pairs
from tests.support import oscillator
from tests.support.places import DATA, ROOT

ROUNDING = 2
"""Flights that rounding on another processor may move across a bound."""


def kept() -> list[Pair]:
    """The table written by `make studies`."""
    with (DATA / "validity_matrix.csv").open() as file:
        return TypeAdapter(list[Pair]).validate_python(list(csv.DictReader(file)))


def test_every_pair_of_the_catalog_is_in_the_table() -> None:
    same = {(pair.monitor, pair.aircraft) for pair in kept() if pair.command == "same"}
    assert same == {(monitor, aircraft) for monitor in MODELS for aircraft in MODELS}


def test_another_aircraft_is_called_invalid_by_the_end() -> None:
    for pair in kept():
        if not pair.is_own:
            assert pair.invalid_failing >= 0.99 * pair.n_failing, pair
            assert pair.share_invalid >= 0.85, pair


def test_a_withdrawal_within_the_lead_counts_as_a_miss(monkeypatch) -> None:
    """Failures at 20: withdrawn a lead before, one sample later, and never."""
    monitor = train(oscillator.collect(np.random.default_rng(1), n_unsafe=40))
    y, fail = np.zeros((3, oscillator.N_SAMPLES, 6)), np.full(3, 20)
    first = 20 - monitor.h + np.array([0, 1, oscillator.N_SAMPLES])
    monkeypatch.setattr(Monitor, "first_withdrawn", lambda *_: first)
    monkeypatch.setattr(Monitor, "highest_p_values", lambda *_: np.zeros(3))
    *_, missed, unwarned = counts_of(monitor, y, fail).tolist()
    assert (missed, unwarned) == (3, 2)


def test_the_own_aircraft_is_called_invalid_at_its_level() -> None:
    """At most the level for both kinds, on average over monitors, within three standard errors."""
    own = [pair for pair in kept() if pair.is_own]
    for wrong, flown in (("invalid_safe", "n_safe"), ("invalid_failing", "n_failing")):
        shares = np.array([getattr(pair, wrong) / getattr(pair, flown) for pair in own])
        assert shares.mean() <= 0.02 + 3 * shares.std(ddof=1) / np.sqrt(len(own))


def test_a_recomputed_part_equals_the_table() -> None:
    """The pair with the most misses so far: an ATTAS under a DC-8's monitor."""
    recipe = MatrixRecipe(monitors=("dc8_15k_m0p44",), aircraft=("attas_id_16kft",))
    rows = {(pair.monitor, pair.aircraft, pair.command): pair for pair in kept()}
    for pair in pairs(recipe):
        row = rows[pair.monitor, pair.aircraft, pair.command]
        assert (pair.amplitude_deg, pair.limit_g) == (row.amplitude_deg, row.limit_g)
        for name in ("n_safe", "n_failing", "invalid_safe", "invalid_failing", "missed"):
            assert abs(getattr(pair, name) - getattr(row, name)) <= ROUNDING, name
        assert abs(pair.valid_and_missed - row.valid_and_missed) <= ROUNDING


def test_the_guide_gives_the_figures_of_the_table() -> None:
    others = [pair for pair in kept() if not pair.is_own]
    counted = [pair for pair in others if pair.n_failing >= 100]
    worst = max(pair.share_unwarned or 0.0 for pair in counted)
    page = ROOT / "static" / "guide" / "method.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    above = sum((pair.share_unwarned or 0.0) > MonitorRecipe().epsilon for pair in counted)
    valid = sum(pair.n_failing - pair.invalid_failing for pair in others)
    assert (
        f"of {sum(pair.n_failing for pair in others):,} exceeding flights of another aircraft "
        f"{sum(pair.valid_and_missed for pair in others):,} had neither an alert nor a withdrawal "
        f"in time (0.25 s ahead), at most {100 * worst:.1f} % in any of {len(counted)} pairs and "
        f"more than 10 % in {above} of them. By the exceedance itself all but {valid} were"
    ) in text


def test_unknown_aircraft_are_refused() -> None:
    with pytest.raises(ValueError, match="no published model 'spitfire'; there are f16"):
        MatrixRecipe(monitors=("spitfire",))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="n_failing=0 was given: it must be at least 1"):
        MatrixRecipe(n_failing=0)
