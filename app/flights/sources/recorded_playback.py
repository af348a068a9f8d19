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
from app.assessment.trim import TrimSteps
from app.flights.planned_card import first_input
from app.flights.sources.playback import Angles, StoredScript, onsets
from app.recordings.scoring_answers import reason
from core.channels import LATERAL
from core.kernels.causal_grid import RATE_RATIO
from core.limits.exceedance import NOT_PLAUSIBLE, SAME_TIME
from core.limits.limits import Envelope
from core.monitor import Assessment, Monitor
from core.simulation.attitude import WASH_OUT_S, DisplayAttitude
from core.types import Array, Indices

P, R = LATERAL.index("p"), LATERAL.index("r")
RUN_UP_S = 2 * WASH_OUT_S
"""A missing attitude is integrated from this time before its sample [s]."""

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
        self.near = RATE_RATIO * dt
        judged = [s["exceedance"] for s in manoeuvres if s["exceedance"] is not None]
        self.fail_t = min((exceedance["t"] for exceedance in judged), default=None)
        self.is_checked = all(s["validity"]["valid"] is not None for s in manoeuvres)
        self.manoeuvres = self._manoeuvres = manoeuvres
        begins = [begin for manoeuvre in manoeuvres for begin, _ in manoeuvre["alerts"]]
        self.alerts = np.searchsorted(self.t, np.sort(np.array(begins, float)) - 0.5 * dt)
        self._display = DisplayAttitude(theta0)
        self._displayed = -1
        self._display_scripts = display
        self._trims = self._trims_of(samples, manoeuvres)
        self._biases = np.array(biases or [0.0] * samples["y"].shape[1])
        first = [(e, False) for e in judged] + [(e, bool(e.get("doubt"))) for e in outside]
        first += [(e, True) for s in manoeuvres if (e := s.get("recorded_exceedance"))]
        worst = [(e, not s["exceedance"]) for s in manoeuvres for e in s.get("worst", ())]
        worst += [(e, True) for s in manoeuvres for e in s.get("worst_recorded", ())]
        far = [e for e in outside if e.get("worst_t") is not None]
        worst += [
            ({**e, "t": e["worst_t"], "value": e["worst"]}, bool(e.get("doubt"))) for e in far
        ]
        self.exceedances = np.unique([self._known_at(e["t"]) for e, _ in first]).astype(np.int64)
        self._scored = defaultdict[int, list[tuple[Mapping[str, Any], bool]]](list)
        for each, is_raw in (*first, *worst):
            self._scored[self._known_at(each["t"])].append((each, is_raw))
        self._check: TrimCheck | None = None
        if monitor is not None:
            self._follow(monitor)
            planned = known_test(monitor)
            onsets_of = (self._begins(each, planned) for each in manoeuvres)
            self.begun = [t for t in onsets_of if t is not None]
            if np.nan_to_num(self._trims.values).any():
                self._check = TrimCheck(monitor.dictionary, monitor.envelope)
                # before the first manoeuvre, values count from its trim
                begins = np.append(self.t[:1], self._trims.starts[1:])
                self._check.note_all(begins, self._trims.values)
                self.trims = list(self._check.changes)

    def _trims_of(self, samples: npt.NDArray, manoeuvres: Sequence[Mapping[str, Any]]) -> TrimSteps:
        """As stored; earlier versions stored only that of each manoeuvre, until the next one."""
        if "trim" in (samples.dtype.names or ()):
            return TrimSteps.of_samples(self.t, samples["trim"])
        none = [0.0] * samples["y"].shape[1]
        known = [[nan if v is None else v for v in s.get("trim") or none] for s in manoeuvres]
        starts = self.t[[s.get("first", 0) for s in manoeuvres]] if manoeuvres else self.t[:1]
        return TrimSteps(starts, np.array(known or [none]))

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
        """Sample k with bias and trim, (n_channels,)."""
        return self.samples["y"][k] + self._subtracted(k)

    def far(self, k: int) -> Mapping[str, int]:
        return self._check.far_at(self._trims.at(self.t[k])) if self._check else {}

    def judged(self, k: int) -> Array:
        trim = self._trims.at(self.t[k])
        return np.where(np.isnan(trim), nan, self.samples["y"][k])

    def _subtracted(self, k: Indices | int) -> Array:
        """Trim and bias, (..., n_channels)."""
        return np.nan_to_num(self._trims.at(self.t[k])) + self._biases

    def received(self, k: int, limits: Envelope | None) -> Sequence[ReceivedExceedance]:
        """The recorded samples with which an exceedance began or was worst, as it was scored."""
        received = list[ReceivedExceedance]()
        for each, is_raw in self._scored.get(k, ()):
            t, value, c = each["t"], each["value"], self.keys.index(each["channel"])
            if limits is None or not limits.is_beyond(c, value):
                continue
            trim = self._trims.at(self.t[self._at(t)])
            offset = float(trim[c] + self._biases[c])
            is_plausible = each.get("doubt") != NOT_PLAUSIBLE
            both = (
                (value - offset if is_plausible else nan, value)
                if is_raw
                else (value, value + offset)
            )
            y, recorded = np.full((2, len(self.keys)), nan)
            y[c], recorded[c] = both
            about = y, recorded, limits, "", is_plausible
            received.append(ReceivedExceedance(t, True, *about))
        return received

    def exceeding(self, limits: Envelope | None) -> Indices:
        if limits is None:
            return np.empty(0, np.int64)
        y = self.samples["y"]
        recorded = y + self._subtracted(np.arange(len(y)))
        over = limits.exceeds(y) | limits.exceeds(recorded)
        for k in self._scored:
            over[k] |= bool(self.received(k, limits))
        return onsets(over)

    def _known_at(self, t: float) -> int:
        """First sample by which one recorded at t [s] counts, as one received does in flight."""
        return self._at(t - self.near)

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
