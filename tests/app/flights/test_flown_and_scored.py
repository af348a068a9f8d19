"""The record of a live flight and the scoring of its recording give one verdict."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from app.assessment.outcome import OUTCOMES, verdict_of
from core.channels import KEYS
from core.types import Array
from tests.support.flown_and_scored import (
    DT,
    LEAD_IN_S,
    NY,
    FlownAndScored,
    doublets,
    flown_and_scored,
    in_order,
)

BEGINS = round(LEAD_IN_S / DT)


def with_channel(y: Array, key: str, value: float, first: int, stop: int | None = None) -> Array:
    changed = y.copy()
    changed[first:stop, KEYS.index(key)] = value
    return changed


def at_rest(ny: float = 0.0) -> Array:
    """Six seconds of rest; N_y takes a value in the last second."""
    y = 1e-5 * np.random.default_rng(3).standard_normal((120, len(KEYS)))
    y[100:, NY] += ny
    return y


def frozen_ny() -> Array:
    y = doublets(fail=False)[0]
    y = y + 1e-4 * np.random.default_rng(3).standard_normal(y.shape)
    return with_channel(y, "Ny", y[BEGINS + 4, NY], BEGINS + 5)


def words(both: FlownAndScored) -> tuple[str, str]:
    """Of the record and of the only manoeuvre of the scoring, up to a colon."""
    (manoeuvre,) = both.scored.manoeuvres
    verdict, headline = both.record.verdict, both.record.headline.status
    scored = verdict_of(asdict(manoeuvre)) or OUTCOMES[manoeuvre.outcome].word
    record = headline.replace("_", " ").upper() if verdict is None else verdict.text
    return record.split(":")[0], scored


def test_an_alert_in_one_part_of_a_manoeuvre_warns_of_an_exceedance_in_the_next(
    tmp_path: Path,
) -> None:
    """The condition changes after the alert; the next monitor needs the beginning."""
    y = doublets(fail=True)[0]
    mach = [0.6] * (len(y) - 10) + [0.9] * 10
    both = flown_and_scored(tmp_path, in_order(y, mach), by_set=True)
    before, after = both.scored.manoeuvres
    assert before.alerts
    assert (before.outcome, after.alerts) == ("cut", ())
    assert after.lead is not None
    assert both.record.verdict is not None
    assert both.record.verdict.text == verdict_of(asdict(after))


@pytest.mark.parametrize(
    ("y", "word"),
    [
        (doublets(fail=False)[0][: BEGINS + 20], "ENDS WITHIN THE MANOEUVRE"),
        (with_channel(doublets(fail=False)[0], "beta", np.nan, 70, 80), "DATA MISSING"),
        (with_channel(doublets(fail=False)[0], "Ny", np.nan, 70, 80), "DATA MISSING"),
        (with_channel(doublets(fail=False)[0], "Ny", np.nan, BEGINS + 1), "DATA MISSING"),
        (with_channel(doublets(fail=False)[0], "beta", np.nan, BEGINS), "DATA MISSING"),
        (
            with_channel(doublets(fail=True)[0], "beta", np.nan, BEGINS),
            "LIMIT EXCEEDED, data missing, no verdict",
        ),
        (
            with_channel(doublets(fail=True)[0], "beta", np.nan, len(doublets(fail=True)[0]) - 25),
            "LIMIT EXCEEDED, data missing, no verdict",
        ),
        (frozen_ny(), "DATA MISSING"),
        (at_rest(), "NOT ASSESSED"),
        (at_rest(0.7), "LIMIT EXCEEDED outside every manoeuvre, where nothing was assessed"),
    ],
    ids=[
        "cut",
        "beta",
        "Ny",
        "no_Ny",
        "no_beta",
        "exceeds_without_beta",
        "beta_before_it",
        "frozen_Ny",
        "rest",
        "exceeds_at_rest",
    ],
)
def test_a_flight_and_the_scoring_of_its_recording_have_one_word(
    tmp_path: Path, y: Array, word: str
) -> None:
    assert words(flown_and_scored(tmp_path, in_order(y))) == (word, word)


def test_an_abort_after_the_alert_is_told_by_the_record_too(tmp_path: Path) -> None:
    y = doublets(fail=True)[0][:-10]
    calls = [(len(y) - 1) * DT]
    both = flown_and_scored(tmp_path, in_order(y), calls=calls)
    assert words(both) == ("ABORTED AFTER THE ALERT",) * 2


def test_data_missing_at_rest_are_told_by_the_scoring_too(tmp_path: Path) -> None:
    y = doublets(fail=False)[0]
    both = flown_and_scored(tmp_path, in_order(with_channel(y, "Ny", np.nan, 20, 26)))
    assert both.record.verdict is not None
    why = both.record.verdict.text.removeprefix("DATA MISSING: ")
    assert f"Data missing outside every manoeuvre: {why}." in both.scored.notes


def test_samples_at_rest_are_not_called_invalid(tmp_path: Path) -> None:
    (rest,) = flown_and_scored(tmp_path, in_order(at_rest())).scored.manoeuvres
    assert rest.guarantee == "No guarantee: no manoeuvre was flown."
    assert not any("invalid" in remark for remark in rest.remarks)
