"""A scored recording as a flight to play.

It replays the stored assessments bit for bit and scores nothing again, so ten hours start as
quickly as ten seconds.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from math import nan
from typing import Any

import numpy as np
import numpy.typing as npt

from app.assessment.grid import IntegratedAngles
from app.assessment.input_checks import TrimCheck
from app.assessment.limits_history import InForceTimeline
from app.assessment.planned_test import PlannedTest, known_test
from app.assessment.rulings import InForceFrom, Ruling
from app.assessment.scorer import ReceivedExceedance
from app.flights.planned_card import first_input
from app.flights.sources.playback import Angles, StoredScript, onsets
from app.recordings.scoring_answers import reason
from core.channels import LATERAL
from core.kernels.causal_grid import RATE_RATIO
from core.limits.exceedance import SAME_TIME, Exceeded, Judged, MeasuredExceedance
from core.limits.limits import Envelope
from core.monitor import Assessment, Monitor
from core.simulation.attitude import WASH_OUT_S, DisplayAttitude
from core.types import Array, Indices

P, R = LATERAL.index("p"), LATERAL.index("r")
RUN_UP_S = 2 * WASH_OUT_S
"""A missing attitude is integrated from this time before its sample [s]."""

SOON = 2
"""Samples within RATE_RATIO intervals."""
SOUGHT_AT_ONCE = 5_000
"""Samples in which an input is looked for at once."""


class RecordedScript(StoredScript):
    """Stored samples and their scored manoeuvres.

    samples: as app.assessment stores them, mapped.   manoeuvres: plain, see app.assessment.
    forecasts: whether the monitor makes forecasts.   outside: exceedances outside every manoeuvre,
    plain.   biases: (n_channels,) that the mapping subtracted; none if empty.
    theta0: pitch at trim [rad], for the scene.
    display: the recording as scored by the monitors for display.   held: limits that were in force;
    None for none.
    monitor: by which it was scored, for what that forecasts of the rest of a card; None for none.
    """

    def __init__(
        self,
        samples: npt.NDArray,
        manoeuvres: Sequence[Mapping[str, Any]],
        dt: float,
        *,
        forecasts: bool,
        outside: Sequence[Mapping[str, Any]] = (),
        biases: Sequence[float] = (),
        theta0: float = 0.0,
        display: Sequence["RecordedScript"] = (),
        held: InForceTimeline | None = None,
        monitor: Monitor | None = None,
    ) -> None:
        super().__init__(samples, dt, forecasts)
        self.t = np.ascontiguousarray(samples["t"])
        self._held, self.shows_rulings = held, held is not None
        judged = [s["exceedance"] for s in manoeuvres if s["exceedance"] is not None]
        self.fail_t = min((exceedance["t"] for exceedance in judged), default=None)
        recorded = [e for s in manoeuvres if (e := s.get("recorded_exceedance")) is not None]
        recorded += [e for e in outside if e.get("doubt")]
        judged += [e for e in outside if not e.get("doubt")]
        self._exceedances = {self._at(e["t"]): e for e in judged}
        self._recorded_exceedances = {self._at(e["t"]): e for e in recorded}
        self.is_checked = all(s["validity"]["valid"] is not None for s in manoeuvres)
        self.manoeuvres = self._manoeuvres = manoeuvres
        begins = [begin for manoeuvre in manoeuvres for begin, _ in manoeuvre["alerts"]]
        self.alerts = np.searchsorted(self.t, np.sort(np.array(begins, float)) - 0.5 * dt)
        beyond = sorted({*self._exceedances, *self._recorded_exceedances})
        self.exceedances = np.array(beyond, np.int64)
        self._display = DisplayAttitude(theta0)
        self._displayed = -1
        self._display_scripts = display
        known = [s.get("trim") or () for s in manoeuvres]
        none = [0.0] * samples["y"].shape[1]
        trims = [[value or 0.0 for value in trim] or none for trim in known]
        biases = biases or none
        self._offsets = np.array([*trims, none]) + biases
        unknown = [[nan if value is None else 0.0 for value in trim] or none for trim in known]
        self._unknown = np.array([*unknown, none])
        self._starts = np.array([s.get("first", 0) for s in manoeuvres])
        worst = [(e, not s["exceedance"]) for s in manoeuvres for e in s.get("worst", ())]
        worst += [(e, True) for s in manoeuvres for e in s.get("worst_recorded", ())]
        far = [e for e in outside if e.get("worst_t") is not None]
        worst += [
            ({**e, "t": e["worst_t"], "value": e["worst"]}, bool(e.get("doubt"))) for e in far
        ]
        self._worst = defaultdict[int, list[tuple[Mapping[str, Any], bool]]](list)
        for each, is_raw in worst:
            self._worst[self._at(each["t"])].append((each, is_raw))
        self._far: list[Mapping[str, int]] = []
        self._envelope = None if monitor is None else monitor.envelope
        if monitor is not None:
            self._follow(monitor)
            planned = known_test(monitor)
            onsets_of = (self._begins(each, planned) for each in manoeuvres)
            self.begun = [t for t in onsets_of if t is not None]
            if any(map(any, trims)):
                check = TrimCheck(monitor.dictionary, monitor.envelope)
                begins = [0, *self._starts[1:].tolist()]  # before the first, values count from it
                levels = self._offsets + self._unknown - biases
                for begin, trim in zip(begins, levels[:-1], strict=True):
                    check.note(float(self.t[begin]), trim)
                    self._far.append(check.far)
                self.trims = list(check.changes)

    def _begins(self, manoeuvre: Mapping[str, Any], planned: PlannedTest) -> float | None:
        """Time of the first input of a manoeuvre [s]; None where no control departs."""
        if (begins := manoeuvre.get("begins")) is not None:
            return begins
        ends = manoeuvre.get("start", -np.inf), manoeuvre.get("end", np.inf)
        first, stop = np.searchsorted(self.t, ends).tolist()
        for at in range(first, stop, SOUGHT_AT_ONCE):
            onset = first_input(self.samples["y"][at : min(at + SOUGHT_AT_ONCE, stop)], planned)
            if onset is not None:
                return float(self.t[at + onset])
        return None

    def _first_of_card(self, k: int) -> int | None:
        number = int(self.samples["manoeuvre"][k])
        return None if number < 0 else self._manoeuvres[number].get("first")

    def ruling(self, k: int) -> Ruling | None:
        return None if self._held is None else self._held.ruling(float(self.t[k]))

    def held_until(self, k: int) -> list[InForceFrom]:
        if self._held is None:
            return []
        begins = np.searchsorted(self.t, self._held.starts)
        held = zip(begins.tolist(), self._held.rulings, strict=True)
        by_sample = {begin: ruling for begin, ruling in held if begin <= k}
        return [
            InForceFrom(float(self.t[i]) if i else None, ruling) for i, ruling in by_sample.items()
        ]

    def recorded(self, k: int) -> Array:
        """Sample k with bias and trim, (n_channels,); between manoeuvres by the last one's trim."""
        return self.samples["y"][k] + self._offsets[self._last_manoeuvre(k)]

    def far(self, k: int) -> Mapping[str, int]:
        return self._far[self._last_manoeuvre(k)] if self._far else {}

    def judged(self, k: int) -> Array:
        return self.samples["y"][k] + self._unknown[self._last_manoeuvre(k)]

    def _last_manoeuvre(self, k: int) -> int:
        return max(int(np.searchsorted(self._starts, k, "right")) - 1, 0)

    def received(self, k: int) -> Sequence[ReceivedExceedance]:
        """The sensor's own worst value of an exceedance, which resampling may have lessened."""
        ruling, received = self.ruling(k), list[ReceivedExceedance]()
        limits = self._envelope if ruling is None else ruling.limits
        for worst, is_raw in self._worst.get(k, ()):
            c = self.keys.index(worst["channel"])
            if limits is not None and limits.is_beyond(c, worst["value"]):
                unknown = np.full(len(self.keys), nan)
                y = np.where(np.arange(len(self.keys)) == c, worst["value"], nan)
                about = worst["t"], True, unknown if is_raw else y, y, limits
                received.append(ReceivedExceedance(*about))
        return received

    def exceeded(self, k: int, limits: Envelope | None) -> Exceeded | None:
        """The limit that sample k exceeds, or the recording between it and the last sample.

        The recorded sample gives an exceedance its time, also where interpolation between it and
        the one before lies beyond the limit earlier.
        """
        if limits is None:
            return None
        if (recorded := self._recorded_exceedance(k, limits)) is not None:
            return recorded
        soon = range(k + 1, min(k + 1 + SOON, len(self.t)))
        later = [each for i in soon if (each := self._recorded_exceedance(i, limits)) is not None]
        if any(each.t - float(self.t[k]) < RATE_RATIO * self.dt for each in later):
            return None
        return super().exceeded(k, limits)

    def _recorded_exceedance(self, k: int, limits: Envelope) -> Exceeded | None:
        """The scored exceedance that begins between sample k - 1 and k."""
        between = self._exceedances.get(k) or self._recorded_exceedances.get(k)
        if between is None:
            return None
        channel, value = between["channel"], between["value"]
        c = self.keys.index(channel)
        if not limits.is_beyond(c, value):
            return None
        judged: Judged = "recorded"
        if k in self._exceedances:
            as_recorded = value + float((self.recorded(k) - self.y(k))[c])
            judged = "both" if limits.is_beyond(c, as_recorded) else "from_trim"
        about = channel, value, limits.exceeded(c, value), judged, between.get("doubt", "")
        return Exceeded(between["t"], MeasuredExceedance(*about))

    def exceeding(self, limits: Envelope | None) -> Indices:
        if limits is None:
            return np.empty(0, np.int64)
        y = self.samples["y"]
        before = np.searchsorted(self._starts, np.arange(len(y)), "right") - 1
        recorded = y + self._offsets[np.maximum(before, 0)]
        over = limits.exceeds(y) | limits.exceeds(recorded)
        for k in (*self._exceedances, *self._recorded_exceedances):
            for i in range(max(k - SOON, 0), k + 1):
                over[i] = self.exceeded(i, limits) is not None
        return onsets(over)

    def _at(self, t: float) -> int:
        """First sample at or after a time [s]; the last one if there is none."""
        return min(int(np.searchsorted(self.t, t - SAME_TIME)), len(self.t) - 1)

    def attitude(self, k: int) -> Angles:
        """As recorded; missing angles are integrated from the rates."""
        recorded = self.samples["attitude"][k]
        known = np.isfinite(recorded)
        if known.all() or self.keys != LATERAL.keys:
            phi, theta, psi = recorded.tolist()
            return phi, theta, psi
        return IntegratedAngles(*np.where(known, recorded, self._integrated(k)).tolist())

    def _reason(self, k: int) -> str:
        sample = self.samples[k]
        about = int(sample["state"]), float(sample["t"]), int(sample["manoeuvre"])
        return reason(*about, self._manoeuvres)

    def display(self, k: int) -> tuple[Assessment, ...]:
        return tuple(script.assessment(k) for script in self._display_scripts)

    def _integrated(self, k: int) -> Angles:
        """Integrate from the sample shown before, or after a jump from some time before it."""
        if k != self._displayed + 1:
            self._display.restart()
            self._displayed = max(k - round(RUN_UP_S / self.dt), 0) - 1
        y, angles = self.samples["y"], None
        for i in range(self._displayed + 1, k + 1):
            angles = self._display.update(self.t[i], float(y[i, P]), float(y[i, R]))
        self._displayed = k
        assert angles is not None
        return angles
