"""The record of a live flight and the scoring of its recording give one verdict."""

from dataclasses import asdict
from pathlib import Path

from app.assessment.outcome import verdict_of
from tests.support.flown_and_scored import doublets, flown_and_scored, in_order


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
