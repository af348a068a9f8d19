"""Alarms: raised once an onset, latched until acknowledged."""

from dataclasses import replace
from functools import partial

import pytest

from app.flights.alarms import CLOSED_KEPT, REJOIN_S, Alarms
from core.limits.exceedance import NOT_PLAUSIBLE, Exceeded, MeasuredExceedance
from core.monitor import Assessment, State
from core.monitor.assessment import Cause
from core.monitor.status import BETWEEN, Level, cause_of
from tests.support.flying import ScriptedClock

DT = 0.1


class Script:
    """A flight of alerts (1), none (0) and samples that could not be assessed (-)."""

    def __init__(self) -> None:
        self.alarms, self.clock, self.seq = Alarms(), ScriptedClock(), -1

    def fly(self, script: str, index: int | None = None) -> list[int]:
        """Fly on; return the seq of each alarm raised. index: of the first sample."""
        raised = []
        for k, word in enumerate(script):
            self.seq += 1
            sample = self.seq if index is None else index + k
            ok = word != "-"
            said = Assessment(
                sample * DT,
                0.5 if ok else None,
                word == "1" if ok else None,
                State.OK if ok else State.INVALID,
                "" if ok else BETWEEN,
                cause=None if ok else Cause.BETWEEN,
            )
            alarms = self.alarms.update(self.seq, sample, said, None, self.clock)
            raised += [alarm.seq for alarm in alarms]
        return raised


OVER = MeasuredExceedance(channel="Ny", value=0.529, limit=0.5, judged="both")


def exceed(alarms: Alarms, script: str, state: State = State.INVALID) -> list[tuple[int, str]]:
    """Fly samples beyond a limit (1) or within (0), not assessed; seq and kind raised."""
    raised, clock = [], ScriptedClock()
    for seq, word in enumerate(script):
        said = Assessment(seq * DT, None, None, state, BETWEEN, cause=Cause.BETWEEN)
        over = Exceeded(seq * DT, OVER) if word == "1" else None
        raised += [(a.seq, a.kind) for a in alarms.update(seq, seq, said, over, clock)]
    return raised


def test_a_surer_exceedance_rings_once_without_a_break() -> None:
    """A value that no aircraft reaches, then one as recorded, then one from trim, and back."""
    raw = MeasuredExceedance(channel="Ny", value=1e12, limit=0.5, judged="recorded")
    odd, sure = replace(raw, doubt=NOT_PLAUSIBLE), Exceeded(0.0, OVER)
    kinds = {"o": Exceeded(0.0, odd), "r": Exceeded(0.0, raw), "1": sure, "0": None}
    alarms, clock, rang = Alarms(), ScriptedClock(), []
    for seq, word in enumerate("oorr110101r1o"):
        said = Assessment(seq * DT, None, None, State.INVALID, BETWEEN, cause=Cause.BETWEEN)
        rang += [a.seq for a in alarms.update(seq, seq, said, kinds[word], clock)]
    assert rang == [0, 2, 4]
    received, rang = Alarms(), []
    for seq, word in enumerate("oo1o1"):
        exceeded = kinds[word]
        assert exceeded is not None
        rang += [a.seq for a in received.exceed(seq, seq, exceeded, "", clock)]
    assert rang == [0, 2]


CALM = "0" * (round(REJOIN_S / DT) + 1)


def test_an_alarm_is_raised_at_the_onset_and_not_again() -> None:
    assert Script().fly("001111111110") == [2]


def test_an_alert_at_the_first_sample_is_an_onset() -> None:
    assert Script().fly("11") == [0]


def test_the_next_onset_is_an_alarm_of_its_own() -> None:
    assert Script().fly(f"11{CALM}11") == [0, len(CALM) + 2]


def test_a_flickering_alert_is_one_alarm_while_it_is_open() -> None:
    assert Script().fly("101010010001") == [0]


def test_after_acknowledgement_every_onset_rings() -> None:
    script = Script()
    assert script.fly("11") == [0]
    script.alarms.acknowledge("1", "FTE", "now")
    assert script.fly("11") == []
    assert script.fly("01") == [5]


def test_a_sample_that_cannot_be_assessed_ends_no_alert() -> None:
    unknown = "-" * len(CALM)
    assert Script().fly(f"11{unknown}11") == [0]


def test_an_onset_flown_again_is_one_alarm_acknowledged_or_not() -> None:
    script = Script()
    assert script.fly("0011", index=0) == [2]
    script.alarms.restart()
    assert script.fly("0011", index=0) == []
    script.alarms.acknowledge("1", "FTE", "now")
    for first in (0, 3):  # a loop, and a step back into the alert
        script.alarms.restart()
        assert script.fly("0011"[first:], index=first) == []
    assert script.alarms.n_open(Level.WARNING) == 0


def test_an_onset_that_joined_an_alarm_is_acknowledged_with_it() -> None:
    script = Script()
    assert script.fly("01011", index=0) == [1]
    script.alarms.acknowledge("1", "FTE", "now")
    script.alarms.restart()
    assert script.fly("1", index=4) == []


def test_under_other_limits_the_same_sample_rings_again() -> None:
    script = Script()
    assert script.fly("01", index=0) == [1]
    script.alarms.acknowledge("1", "FTE", "now")
    script.alarms.forget()
    script.alarms.restart()
    assert script.fly("01", index=0) == [3]


def test_a_loop_with_two_alerts_rings_once_for_each_while_both_are_open() -> None:
    script = Script()
    assert script.fly(f"1{CALM}1{CALM}", index=0) == [0, len(CALM) + 1]
    for _ in range(3):
        script.alarms.restart()
        assert script.fly(f"1{CALM}1{CALM}", index=0) == []


def test_a_restart_begins_a_new_alert() -> None:
    script = Script()
    assert script.fly("11", index=0) == [0]
    script.alarms.restart()
    assert script.fly("11", index=40) == [2]


def test_the_first_acknowledgement_stays() -> None:
    script = Script()
    script.fly("1")
    alarm, is_first = script.alarms.acknowledge("1", "FTE", "then")
    assert is_first
    assert (alarm.acknowledged, alarm.by) == ("then", "FTE")
    assert script.alarms.acknowledge("1", "pilot", "later") == (alarm, False)
    assert script.alarms.n_open(Level.WARNING) == 0
    with pytest.raises(KeyError):
        script.alarms.acknowledge("2", "FTE", "now")


def test_open_alarms_are_all_at_hand_and_acknowledged_ones_bounded() -> None:
    script = Script()
    for k in range(2 * CLOSED_KEPT):
        script.fly(f"1{CALM}")
        if k >= 3:
            script.alarms.acknowledge(str(k + 1), "FTE", "now")
    numbers = [alarm.number for alarm in script.alarms.at_hand]
    assert numbers == [1, 2, 3, *range(CLOSED_KEPT + 1, 2 * CLOSED_KEPT + 1)]
    assert [alarm.id for alarm in script.alarms.at_hand] == [str(n) for n in numbers]


@pytest.mark.parametrize("state", [State.INVALID, State.WARMING_UP])
def test_an_exceedance_is_an_alarm_whatever_the_monitor_can_say(state: State) -> None:
    alarms = Alarms()
    assert exceed(alarms, "0011100", state) == [(2, "limit")]
    (alarm,) = alarms.at_hand
    assert (alarm.level, alarm.exceedance, alarm.p_value) == ("warning", OVER, None)


def test_an_exceedance_follows_the_rules_of_latching_on_its_own() -> None:
    alarms = Alarms()
    assert exceed(alarms, f"101{CALM}1") == [(0, "limit"), (3 + len(CALM), "limit")]
    alarms.acknowledge("1", "FTE", "now")
    alarms.acknowledge("2", "FTE", "now")
    assert exceed(alarms, "0") == []
    assert exceed(alarms, "1") == [(0, "limit")]
    alarms.acknowledge("3", "FTE", "now")
    alarms.restart()
    assert exceed(alarms, "1") == []


def test_risk_and_exceedance_at_one_sample_are_two_alarms() -> None:
    alarms = Alarms()
    said = Assessment(0.0, 0.5, True, State.OK)
    raised = alarms.update(0, 0, said, Exceeded(0.0, OVER), ScriptedClock())
    assert [(alarm.id, alarm.kind) for alarm in raised] == [("1", "limit"), ("2", "risk")]
    assert alarms.n_open(Level.WARNING) == 2


# --- cautions ------------------------------------------------------------------------------------


STATES = {
    "1": (State.INVALID, "outside training"),
    "-": (State.INVALID, BETWEEN),
    "w": (State.WARMING_UP, ""),
    "s": (State.STALE, "the sample has the same time as the previous one"),
}


def states(alarms: Alarms, script: str, seq: int = 0) -> list[tuple[int, str]]:
    """Fly samples of these states, 0 for ok; seq and kind raised."""
    raised, clock = [], ScriptedClock()
    for k, word in enumerate(script, start=seq):
        state, reason = STATES.get(word, (State.OK, ""))
        ok = state is State.OK
        values = (0.1, False) if ok else (None, None)
        said = Assessment(k * DT, *values, state, reason, cause=cause_of(state, reason))
        raised += [(a.seq, a.kind) for a in alarms.update(k, k, said, None, clock)]
        clock.advance(DT)
    return raised


def test_a_lost_validity_is_one_caution_with_its_reason_and_no_warning() -> None:
    alarms = Alarms()
    assert states(alarms, "w0011111") == [(3, "invalid")]
    (alarm,) = alarms.at_hand
    assert (alarm.level, alarm.reason, alarm.p_value) == ("caution", "outside training", None)
    assert (alarms.n_open(Level.WARNING), alarms.n_open(Level.CAUTION)) == (0, 1)


def test_nothing_is_lost_between_manoeuvres_but_again_in_the_next_one() -> None:
    between = "-" * (len(CALM) + 1)
    assert states(Alarms(), f"{between}11{between}1") == [
        (len(between), "invalid"),
        (2 * len(between) + 2, "invalid"),
    ]


def test_seeking_about_where_validity_is_lost_rings_no_second_time() -> None:
    alarms = Alarms()
    assert states(alarms, "011") == [(1, "invalid")]
    alarms.acknowledge("1", "FTE", "now")
    alarms.restart()
    assert states(alarms, "11", seq=40) == []
    assert states(alarms, "01", seq=42) == [(43, "invalid")]


def test_a_source_that_is_late_again_raises_a_caution_of_its_own_and_a_flicker_none() -> None:
    alarms, clock = Alarms(), ScriptedClock()
    late = partial(alarms.note_late, index=0, t=0.0, reason="no sample came", clock=clock)
    said = Assessment(0.1, 0.1, False, State.OK)
    assert [(alarm.kind, alarm.seq, alarm.reason) for alarm in late(0)] == [
        ("stale", 0, "no sample came")
    ]
    clock.advance(0.25)
    assert late(0) == []
    clock.advance(0.25)
    assert alarms.update(1, 1, said, None, clock) == []
    clock.advance(0.25)
    assert late(1) == []
    alarms.update(2, 2, said, None, clock)
    clock.advance(REJOIN_S + 0.1)
    assert [alarm.kind for alarm in late(2)] == ["stale"]


def test_a_sample_that_repeats_its_time_is_stale_once_also_where_nothing_follows() -> None:
    alarms = Alarms()
    assert states(alarms, "0sss") == [(1, "stale")]
    assert alarms.note_late(3, 3, 0.3, "no sample came", ScriptedClock()) == []
