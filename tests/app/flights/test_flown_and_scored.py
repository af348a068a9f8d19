"""The record of a live flight and the scoring of its recording give one verdict."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import recfunctions
from sqlalchemy import select, update

from app.assessment.outcome import OUTCOMES, OUTSIDE, verdict_of, wording_of
from app.assessment.wording import verdict
from app.flights.ended import Record, records
from app.store.assessments import UNKNOWN, chunk_of
from app.store.datasets import to_blob
from app.store.store import open_store
from app.store.tables import alarms, assessment_chunks
from core.channels import KEYS
from core.monitor import Monitor
from core.types import Array
from tests.support.attas import fly
from tests.support.flown_and_scored import (
    DT,
    LEAD_IN_S,
    NY,
    Arrival,
    FlownAndScored,
    doublets,
    flown_and_scored,
    in_order,
    slow_monitor,
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


def frozen(key: str, first: int = BEGINS + 5, ny: float = 0.0) -> Array:
    """A channel freezes after noise; N_y takes a value from 3 s after the first input."""
    y = doublets(fail=False)[0]
    y = y + 1e-4 * np.random.default_rng(3).standard_normal(y.shape)
    y[2 * BEGINS :, NY] += ny
    return with_channel(y, key, y[first - 1, KEYS.index(key)], first)


def words(both: FlownAndScored) -> tuple[str, str]:
    """Of the record and of the only manoeuvre of the scoring, up to a colon."""
    (manoeuvre,) = both.scored.manoeuvres
    scored = verdict_of(asdict(manoeuvre)) or OUTCOMES[manoeuvre.outcome].word
    return text_of(both.record).split(":")[0], scored


def text_of(record: Record) -> str:
    status = record.headline.status.replace("_", " ").upper()
    return status if record.verdict is None else record.verdict.text


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


WORDS = pytest.mark.parametrize(
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
        (frozen("Ny"), "DATA MISSING"),
        (frozen("delta_r"), "DATA MISSING"),
        (frozen("delta_r", BEGINS - 5, 0.6), "LIMIT EXCEEDED, data missing, no verdict"),
        (at_rest(), "NOT ASSESSED"),
        (with_channel(at_rest(), "delta_r", np.nan, 40, 80), "DATA MISSING"),
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
        "frozen_rudder",
        "exceeds_with_a_frozen_rudder",
        "rest",
        "rest_without_rudder",
        "exceeds_at_rest",
    ],
)


@WORDS
def test_a_flight_and_the_scoring_of_its_recording_have_one_word(
    tmp_path: Path, y: Array, word: str
) -> None:
    assert words(flown_and_scored(tmp_path, in_order(y))) == (word, word)


@WORDS
def test_a_replay_of_a_flight_has_its_verdict(tmp_path: Path, y: Array, word: str) -> None:
    both = flown_and_scored(tmp_path, in_order(y), replay=True)
    assert both.replayed is not None
    assert text_of(both.replayed).split(":")[0] == word


def test_a_replay_keeps_the_gap_of_its_flight(tmp_path: Path) -> None:
    arrivals = in_order(doublets(fail=False)[0])
    both = flown_and_scored(tmp_path, [*arrivals[:70], *arrivals[92:]], replay=True)
    assert both.replayed is not None
    assert text_of(both.replayed) == text_of(both.record)
    assert text_of(both.record).startswith("DATA MISSING: no sample of Ny")


def test_a_replay_judges_an_exceedance_by_the_samples_shown_before_it(
    attas: Monitor, tmp_path: Path
) -> None:
    """The sample that makes the monitor invalid is the one that exceeds."""
    y = fly(1, 1).y[0][:110].copy()
    y[-1, NY] = 0.5
    both = flown_and_scored(tmp_path, in_order(y), monitor=attas, replay=True)
    assert both.replayed is not None
    assert "sigma off" in both.record.reason
    assert both.record.verdict == both.replayed.verdict
    assert text_of(both.record) == "LIMIT EXCEEDED, missed: no alert before the limit"


@WORDS
def test_a_flight_stored_by_an_earlier_version_has_the_same_verdict(
    tmp_path: Path, y: Array, word: str
) -> None:
    """It has neither causes nor numbers of manoeuvres, only words."""
    known = flown_and_scored(tmp_path, in_order(y)).record
    store = open_store(tmp_path / "store.db")
    with store.engine.begin() as connection:
        for row in connection.execute(select(assessment_chunks)).all():
            names = ["t", "y", "p_value", "alert", "state", "y_hat"]
            samples = recfunctions.repack_fields(chunk_of(row).samples[names])
            same = assessment_chunks.c.first_seq == row.first_seq
            changed = update(assessment_chunks).where(same)
            connection.execute(changed.values(content=to_blob(samples)))
        connection.execute(update(alarms).values(cause=None, arrived=None, manoeuvre=None))
    (info,) = store.flights.all()
    assert (store.flights.assessments(info.id).manoeuvre == UNKNOWN).all()
    again = records(store, [info], anew=True)[info.id]
    store.close()
    assert (again.headline.status, again.cause) == (known.headline.status, known.cause)
    assert [text_of(record).split(":")[0] for record in (again, known)] == [word, word]


def test_an_abort_after_the_alert_is_told_by_the_record_too(tmp_path: Path) -> None:
    y = doublets(fail=True)[0][:-10]
    calls = [(len(y) - 1) * DT]
    both = flown_and_scored(tmp_path, in_order(y), calls=calls)
    assert words(both) == ("ABORTED AFTER THE ALERT",) * 2
    arrivals = in_order(y)
    both = flown_and_scored(tmp_path / "gap", [*arrivals[:20], *arrivals[26:]], calls=calls)
    assert words(both) == ("ABORTED AFTER THE ALERT",) * 2  # although data at rest are missing


def late(y: Array, latency: Array) -> list[Arrival]:
    """latency: (n,) [s] of each sample."""
    t = DT * np.arange(len(y))
    order = np.argsort(t + latency, kind="stable").tolist()
    return [Arrival(float(t[k] + latency[k]), float(t[k]), y[k]) for k in order]


def assert_same_warning(both: FlownAndScored) -> float:
    """The lead of the flight is that of the scoring, and their words are the same."""
    verdict = both.record.verdict
    (scored,) = [each for each in both.scored.manoeuvres if each.exceedance is not None]
    assert verdict is not None
    assert verdict.text == verdict_of(asdict(scored))
    assert verdict.lead is not None
    assert verdict.lead == scored.lead
    return verdict.lead


def test_a_late_link_gives_the_flight_and_its_scoring_one_lead(tmp_path: Path) -> None:
    """An alert counts from when it was shown, its limit from when that sample arrived."""
    y = doublets(fail=True)[0]
    even = assert_same_warning(flown_and_scored(tmp_path / "even", in_order(y)))
    link = np.zeros(len(y))
    link[: -round(0.3 / DT) - 8] = 0.3  # slow until just before the limit
    assert assert_same_warning(flown_and_scored(tmp_path / "late", late(y, link))) < even - 0.1


def test_a_lag_that_lasts_counts_as_if_the_exceedance_had_come_at_once(tmp_path: Path) -> None:
    y = doublets(fail=True)[0]
    even = assert_same_warning(flown_and_scored(tmp_path / "even", in_order(y)))
    link = np.where(np.arange(len(y)) < BEGINS, 0.0, 0.2)
    lagging = assert_same_warning(flown_and_scored(tmp_path / "lagging", late(y, link)))
    assert lagging == pytest.approx(even - 0.2, abs=0.01)
    missed = flown_and_scored(tmp_path / "missed", late(y, (even + 0.1) / 0.2 * link))
    assert words(missed)[1] == "LIMIT EXCEEDED, missed: no alert before the limit"
    assert words(missed)[0] == words(missed)[1].split(":")[0]


def test_what_only_the_whole_manoeuvre_shows_is_an_addition(tmp_path: Path) -> None:
    """The beginning of the input is lost: not the planned one, as only the scoring finds."""
    y = with_channel(doublets(fail=True)[2], "delta_r", np.nan, BEGINS - 2, BEGINS + 8)
    both = flown_and_scored(tmp_path, in_order(y))
    (manoeuvre,) = both.scored.manoeuvres
    assert manoeuvre.validity.valid is False
    assert manoeuvre.guarantee.startswith("Guarantee withdrawn: ")
    wording = wording_of(asdict(manoeuvre))
    assert text_of(both.record).startswith("LIMIT EXCEEDED, ")
    assert wording.text.startswith(f"{text_of(both.record)}; no guarantee: ")
    assert wording.word == f"{text_of(both.record)}; NO GUARANTEE"


@pytest.mark.parametrize(("n_before", "word"), [(4, "warned"), (6, "INVALID, no verdict")])
def test_an_alert_withdrawn_before_its_lead_has_passed_is_no_warning(
    attas: Monitor, tmp_path: Path, n_before: int, word: str
) -> None:
    """beta jumps some samples before the exceedance, and the monitor becomes invalid."""
    flights = fly(60, 1)
    ((y, at),) = [(y, k) for y, k in zip(flights.y, flights.fail_index, strict=True) if k == 90]
    y = y[: at + 8].copy()
    y[at - n_before :, KEYS.index("beta")] += 0.02
    both = flown_and_scored(tmp_path, in_order(y), monitor=attas)
    (manoeuvre,) = both.scored.manoeuvres
    ((alert_t, _),), withdrawn_t = manoeuvre.alerts, manoeuvre.withdrawn_t
    assert withdrawn_t is not None
    assert manoeuvre.promised is not None
    assert (alert_t + manoeuvre.promised <= withdrawn_t) == (word == "warned")
    assert text_of(both.record).startswith(f"LIMIT EXCEEDED, {word}")
    assert verdict_of(asdict(manoeuvre)) == text_of(both.record)


def test_the_first_of_exceeding_samples_out_of_order_counts_in_both(tmp_path: Path) -> None:
    y = doublets(fail=True)[0].copy()
    y[-8:-5, NY] *= 1.05
    link = np.zeros(len(y))
    link[len(y) - 8] = 1.2 * DT  # the first one beyond the limit comes after the next
    both = flown_and_scored(tmp_path, late(y, link))
    assert_same_warning(both)
    (exceedance,) = [each.exceedance for each in both.scored.manoeuvres]
    assert both.record.verdict is not None
    assert exceedance is not None
    assert both.record.verdict.exceeded_t == exceedance.t


@pytest.mark.parametrize("n_lost", [6, 8])
def test_a_limit_exceeded_where_the_input_is_first_seen_is_outside_in_both(
    tmp_path: Path, n_lost: int
) -> None:
    """The beginning of the input is lost; what is seen of it first exceeds the limit."""
    y = with_channel(doublets(fail=True)[0], "delta_r", np.nan, BEGINS - 2, BEGINS + n_lost)
    both = flown_and_scored(tmp_path, in_order(y))
    assert words(both) == (OUTSIDE, OUTSIDE)


def test_a_limit_exceeded_just_after_a_manoeuvre_is_outside_in_both(tmp_path: Path) -> None:
    y = doublets(fail=False)[0].copy()
    last = float(flown_and_scored(tmp_path / "safe", in_order(y)).scored.manoeuvres[0].end)
    y[round(last / DT) + 8, NY] = 0.8
    both = flown_and_scored(tmp_path, in_order(y))
    assert text_of(both.record) == OUTSIDE
    assert both.scored.manoeuvres[0].exceedance is None
    assert len(both.scored.outside_exceedances) == 1


def test_samples_too_late_to_be_shown_are_missing_in_both(tmp_path: Path) -> None:
    """The scoring has them: that they exceed no limit is an addition, not another verdict."""
    y = doublets(fail=False)[0]
    link = np.zeros(len(y))
    link[BEGINS + 20 : BEGINS + 26] = 1.0
    both = flown_and_scored(tmp_path, late(y, link))
    assert words(both) == ("DATA MISSING", "DATA MISSING")
    (manoeuvre,) = both.scored.manoeuvres
    why = text_of(both.record).partition(": ")[2]
    late_ones, missing, within, *_ = manoeuvre.remarks
    assert "too late to be shown" in late_ones
    assert missing == f"data missing: {why}"
    assert within.startswith("no recorded sample exceeded a limit: |Ny|")


@pytest.mark.parametrize(
    ("ny", "status", "word"),
    [
        (0.9, "exceeded", "LIMIT EXCEEDED as recorded, trim unknown"),
        (0.1, "invalid", "INVALID: limit from trim unknown"),
    ],
)
def test_without_a_trim_an_exceedance_is_as_recorded_or_unknown(
    tmp_path: Path, ny: float, status: str, word: str
) -> None:
    """The flight begins while the aircraft moves. ny: of its first sample [g]."""
    y = doublets(fail=False)[0][BEGINS + 6 :].copy()
    y[0, NY] = ny
    both = flown_and_scored(tmp_path, in_order(y))
    assert text_of(both.record).startswith(word)
    assert [each.outcome for each in both.scored.manoeuvres] == ["invalid"]
    store = open_store(tmp_path / "store.db")
    (info,) = store.flights.all()
    for alarm in store.alarms.of(info.id):
        store.alarms.acknowledge(info.id, alarm.number, "Ann")
    acknowledged = records(store, [info])[info.id].headline
    store.close()
    assert acknowledged.status == status
    assert acknowledged.level == "caution"


def test_an_exceedance_as_recorded_before_one_from_trim_is_named_first(tmp_path: Path) -> None:
    y = doublets(fail=True)[0].copy()
    y[BEGINS:, NY] += np.where(np.arange(len(y) - BEGINS) < 3, -0.45, 0.0)
    y[:, NY] -= 0.1
    both = flown_and_scored(tmp_path, in_order(y))
    (manoeuvre,) = both.scored.manoeuvres
    raw, first = manoeuvre.recorded_exceedance, manoeuvre.exceedance
    assert raw is not None
    assert first is not None
    text = f"LIMIT EXCEEDED first at {raw.t:.2f} s as recorded, not from trim, and from trim at "
    assert text_of(both.record).startswith(f"{text}{first.t:.2f} s, ")
    assert verdict_of(asdict(manoeuvre)) == text_of(both.record)


def generated(seed: int) -> list[Arrival]:
    """A flight whose rate may change, whose clock may step, and which loses and delays samples."""
    rng = np.random.default_rng(seed)
    flights = doublets(fail=seed % 2 == 1)
    y = flights[rng.integers(len(flights))].copy()
    y += 10.0 ** rng.uniform(-5.0, -3.0) * rng.standard_normal(y.shape)
    t = DT * np.arange(len(y), dtype=np.float64)
    if rng.random() < 0.4:  # faster from some time on
        fine = np.arange(t[rng.integers(len(t))], t[-1], DT / rng.integers(2, 5))
        at = np.concatenate([t[t < fine[0]], fine])
        t, y = at, np.column_stack([np.interp(at, t, column) for column in y.T])
    begin, n = int(rng.integers(len(t))), int(rng.integers(1, 20))
    delays = (
        np.zeros(len(t)),
        np.linspace(0.0, rng.uniform(0.1, 0.6), len(t)),
        rng.exponential(0.1, len(t)) * (rng.random(len(t)) < 0.2),
        rng.uniform(0.1, 1.0) * ((t >= t[begin]) & (t < t[begin] + DT * n)),
    )
    arrived = t + delays[rng.integers(len(delays))]
    kept = np.ones(len(t), bool)
    if rng.random() < 0.5:
        begin = rng.integers(len(t))
        kept[begin : begin + rng.integers(1, 10)] = False
    sent = t + rng.choice([0.0, 0.0, 1000.0, -3.0]) * (t > rng.uniform(1.0, t[-1]))
    order = [k for k in np.argsort(arrived, kind="stable").tolist() if kept[k]]
    return [Arrival(float(arrived[k]), float(sent[k]), y[k]) for k in order]


@pytest.mark.parametrize("seed", [*range(4, 20), 79])  # 79: the limit is exceeded in a gap
def test_a_generated_flight_and_the_scoring_of_its_recording_have_one_verdict(
    tmp_path: Path, seed: int
) -> None:
    both = flown_and_scored(tmp_path, generated(seed))
    record, _, why = text_of(both.record).partition(": ")
    manoeuvres = [asdict(each) for each in both.scored.manoeuvres]
    scored = [verdict_of(each) or OUTCOMES[each["outcome"]].word for each in manoeuvres]
    if both.record.verdict is None:
        assert {each["outcome"] for each in manoeuvres} <= {"quiet", "false_alert"}
    elif any(why and why.split(",")[0] in note for note in both.scored.notes):
        assert record == "DATA MISSING"  # between manoeuvres
    else:
        assert record in [word.split(":")[0] for word in scored]


def test_an_alert_in_another_manoeuvre_warns_of_nothing(tmp_path: Path) -> None:
    y = np.concatenate([doublets(fail=False)[3], doublets(fail=True)[1]])
    both = flown_and_scored(tmp_path, in_order(y))
    before, _ = both.scored.manoeuvres
    assert before.alerts
    assert assert_same_warning(both) < 2.0


def test_how_long_a_manoeuvre_was_flown_counts_its_gaps(tmp_path: Path) -> None:
    arrivals = in_order(doublets(fail=False)[0][: BEGINS + 22])
    whole = flown_and_scored(tmp_path / "whole", arrivals)
    gap = flown_and_scored(tmp_path / "gap", arrivals[: BEGINS + 8] + arrivals[BEGINS + 18 :])
    reasons = (both.scored.manoeuvres[0].validity.reasons for both in (whole, gap))
    (flown,), (flown_with_gap,) = ([why for why in each if "beginning" in why] for each in reasons)
    assert flown == flown_with_gap


def with_lost_samples(y: Array, rows: Sequence[int]) -> Array:
    """Each of these has a value that no aircraft reaches, so the monitor does not use it."""
    changed = y.copy()
    changed[list(rows), KEYS.index("beta")] = 1e3
    return changed


def test_samples_beyond_any_aircraft_are_data_missing_in_both(tmp_path: Path) -> None:
    y = doublets(fail=True)[0]
    lost = range(BEGINS, len(y))
    both = flown_and_scored(tmp_path, in_order(with_lost_samples(y, lost)))
    assert words(both) == ("LIMIT EXCEEDED, data missing, no verdict",) * 2


def test_where_a_trim_is_unknown_both_show_the_value_as_recorded(tmp_path: Path) -> None:
    y = doublets(fail=True)[0] + 0.1 * (np.arange(6) == NY)
    y[BEGINS - 8 : BEGINS + 3] = np.nan
    both = flown_and_scored(tmp_path, in_order(y))
    (manoeuvre,) = both.scored.manoeuvres
    assert manoeuvre.trim[NY] is None
    store = open_store(tmp_path / "store.db")
    stored = store.flights.assessments(store.flights.all()[0].id)
    store.close()
    begun, samples = stored.manoeuvre > 0, both.scored.samples
    shown = dict(zip(stored.t[begun].tolist(), stored.y[begun, NY].tolist(), strict=True))
    scored = dict(zip(samples["t"].tolist(), samples["y"][:, NY].tolist(), strict=True))
    assert shown
    assert shown == {t: scored[t] for t in shown}


def test_data_missing_at_rest_are_told_by_the_scoring_too(tmp_path: Path) -> None:
    y = doublets(fail=False)[0]
    both = flown_and_scored(tmp_path, in_order(with_channel(y, "Ny", np.nan, 20, 26)))
    assert both.record.verdict is not None
    why = both.record.verdict.text.removeprefix("DATA MISSING: ")
    assert f"Data missing outside every manoeuvre: {why}." in both.scored.notes


@pytest.mark.parametrize(("n_gap", "n_after"), [(8, 1), (4, 4), (4, 5), (12, 5), (8, 9)])
def test_data_missing_just_before_the_limit_weigh_alike(
    tmp_path: Path, n_gap: int, n_after: int
) -> None:
    """n_gap: samples without beta.   n_after: those with it, from there to the exceedance."""
    y = doublets(fail=True)[0]
    end = len(y) - 8 - n_after
    y = with_channel(y, "beta", np.nan, end - n_gap, end)
    verdict, scored = words(flown_and_scored(tmp_path, in_order(y)))
    assert verdict == scored


def test_samples_at_rest_are_not_called_invalid(tmp_path: Path) -> None:
    (rest,) = flown_and_scored(tmp_path, in_order(at_rest())).scored.manoeuvres
    assert rest.guarantee == "No guarantee: no manoeuvre was flown."
    assert not any("invalid" in remark for remark in rest.remarks)


@pytest.mark.parametrize("every", [3, 4])
def test_of_too_few_samples_nothing_is_said_of_the_manoeuvre(tmp_path: Path, every: int) -> None:
    """The monitor needs 20 Hz, so it detects no manoeuvre; but one was flown."""
    arrivals = in_order(doublets(fail=False)[0])[::every]
    both = flown_and_scored(tmp_path, arrivals)
    assert words(both) == ("DATA MISSING", "DATA MISSING")
    (manoeuvre,) = both.scored.manoeuvres
    lines = [*manoeuvre.validity.reasons, *manoeuvre.remarks, *both.scored.notes]
    assert any(f"{20 / every:.4g} Hz" in line and "send at 20 Hz" in line for line in lines)
    assert not any("amplitude" in line or "no manoeuvre" in line for line in lines)
    assert manoeuvre.amplitude is None
    printed = "\n".join(verdict(slow_monitor(), both.scored))
    assert "none recorded" not in printed


def test_of_too_few_samples_both_exceed_as_recorded(tmp_path: Path) -> None:
    y = doublets(fail=True)[0]
    (beyond,) = np.flatnonzero(np.abs(y[:, NY]) == np.abs(y[:, NY]).max())
    both = flown_and_scored(tmp_path, in_order(y)[beyond % 4 :: 4])
    word = "LIMIT EXCEEDED as recorded, trim unknown"
    assert words(both) == (word, word)
    assert both.scored.manoeuvres[0].outcome == "unseen"


def test_where_only_a_trim_is_unknown_nothing_is_called_missing(tmp_path: Path) -> None:
    """The flight begins while the aircraft moves; N_y exceeds its limit before the manoeuvre."""
    y = doublets(fail=False)[0][BEGINS + 6 :]
    y[0, NY] = 0.9
    scored = flown_and_scored(tmp_path, in_order(y)).scored
    (manoeuvre,) = scored.manoeuvres
    assert manoeuvre.trim[NY] is None
    lines = [*manoeuvre.validity.reasons, *manoeuvre.remarks]
    lines += [check.text for check in manoeuvre.validity.checks]
    assert not any("missing" in line or "not recorded" in line for line in lines)
    assert any(line.startswith("trim of Ny unknown, as recorded |Ny|") for line in lines)
    assert [each.doubt for each in scored.outside_exceedances] == ["trim unknown"]
    printed = "\n".join(verdict(slow_monitor(), scored))
    assert "exceedance         unknown, trim of Ny unknown" in printed


@pytest.mark.parametrize(
    ("before", "after", "value", "doubts"),
    [
        (-0.3, 0.0, 0.25, []),
        (0.0, 0.3, 0.55, ["as recorded, not from trim"]),
        (0.0, 0.3, -0.25, [""]),
    ],
)
def test_at_rest_a_limit_is_judged_from_the_trim_of_that_rest(
    tmp_path: Path, before: float, after: float, value: float, doubts: list[str]
) -> None:
    """N_y is trimmed anew after the manoeuvre, then takes a value; its limit is 0.5 g."""
    flown = doublets(fail=False)[0]
    y = np.concatenate([0.3 * flown, np.tile(flown[:1], (180, 1))])
    y[:, NY] += np.interp(np.arange(len(y)), [len(flown), len(flown) + 80], [before, after])
    y[-6:, NY] = value
    both = flown_and_scored(tmp_path, in_order(y))
    assert [each.doubt for each in both.scored.outside_exceedances] == doubts
    assert (both.record.verdict is not None) == bool(doubts)


@pytest.mark.parametrize(("rest_s", "is_in_trim"), [(2.0, False), (4.0, True)])
def test_a_manoeuvre_from_the_trim_of_an_earlier_rest_does_not_begin_in_trim(
    tmp_path: Path, rest_s: float, is_in_trim: bool
) -> None:
    flown = 0.3 * doublets(fail=False)[0]
    n_rest = round(rest_s / DT)
    y = np.concatenate([flown, np.tile(flown[:1], (n_rest, 1)), flown[BEGINS:]])
    y[len(flown) :, NY] -= 0.3
    both = flown_and_scored(tmp_path, in_order(y))
    assert both.record.open_cautions == 1  # there, or the trim is a large part of the limit
    _, second = both.scored.manoeuvres
    (check,) = (each for each in second.validity.checks if each.name == "trim")
    assert check.ok == is_in_trim
    assert ("counts from the trim of an earlier rest" in check.text) != is_in_trim
