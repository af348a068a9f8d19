"""An ended live flight, rescored from its journal: what was shown, and when.

The same monitor gives the same bits; another one gives what it would have shown with the samples
received by each moment. The replay keeps the delay of each sample and the stale times.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from app.assessment.grid import IntegratedAngles
from app.assessment.input_checks import Doubt
from app.assessment.recorded import RECEIVED_NEAR
from app.assessment.rulings import InForceFrom, Ruling
from app.assessment.scorer import LiveAssessed, ReceivedExceedance, rescored
from app.flights.flight import stale_after
from app.flights.sources.live import LiveSetup
from app.flights.sources.playback import Angles, StoredScript, onsets
from app.flights.sources.simulated import SourceError
from app.telemetry.journal import lines_of
from core.limits.limits import Envelope
from core.monitor import Assessment
from core.monitor.assessment import CAUSES, Cause, code_of
from core.simulation.attitude import DisplayAttitude
from core.types import Array, Indices


def shown_type(n_channels: int) -> np.dtype:
    """Type of a shown sample; `shown` is the time since the flight began [s]."""
    return np.dtype(
        [
            ("shown", "<f8"),
            ("t", "<f8"),
            ("y", "<f8", (n_channels,)),
            ("judged", "<f8", (n_channels,)),
            ("recorded", "<f8", (n_channels,)),
            ("p_value", "<f8"),
            ("alert", "?"),
            ("state", "u1"),
            ("cause", "u1"),
            ("y_hat", "<f8", (n_channels,)),
            ("attitude", "<f8", (3,)),
            ("is_integrated", "?"),
            ("manoeuvre", "<i4"),
        ]
    )


class ShownFlight(StoredScript):
    """The journal of a flight, scored by a monitor. Slow to make, for a thread.

    Its times are those of the flight, each delayed by as much as its sample was later than the
    quickest one. SourceError if no sample is shown; OSError.
    """

    shows_rulings = True

    def __init__(self, setup: LiveSetup, flight_id: str) -> None:
        self.delay = setup.scorer().delay
        self.is_checked = setup.monitor.support is not None
        self.reasons: list[str] = []
        self._display: list[tuple[Assessment, ...]] = []
        self._rulings: list[Ruling | None] = []
        self._doubts: list[tuple[Doubt, ...]] = []
        self._far: list[Mapping[str, int]] = []
        self._late: list[str] = []
        self._came: list[float] = []
        self.near = RECEIVED_NEAR * setup.dt
        self._is_detected = setup.trim == "detected"
        self._received: dict[int, list[ReceivedExceedance]] = {}
        self.keys = setup.monitor.dictionary.keys
        samples = np.fromiter(self._read(setup, flight_id), shown_type(len(self.keys)))
        super().__init__(samples, setup.dt, setup.monitor.recipe.predictor.forecasts)
        if not len(self.samples):
            raise SourceError(f"flight {flight_id} has no assessed sample: its source sent too few")
        shown = self.samples["shown"]
        self._began = float((shown - self.samples["t"]).min())
        self.t = np.maximum.accumulate(shown - self._began)
        self.alerts = onsets(self.samples["alert"])
        self.exceedances = self.exceeding(setup.monitor.envelope)
        self._begun = np.concatenate([[0], 1 + np.flatnonzero(np.diff(self.samples["manoeuvre"]))])
        begun = self._begun[self.samples["manoeuvre"][self._begun] > 0]
        self.begun = self.samples["t"][begun].tolist()
        self._n_history = setup.monitor.recipe.n_delay + 1
        self._first = 0
        self._follow(setup.monitor)

    def recorded(self, k: int) -> Array:
        return self.samples["recorded"][k]

    def far(self, k: int) -> Mapping[str, int]:
        return self._far[k]

    def manoeuvre(self, k: int) -> int:
        return self.samples["manoeuvre"].item(k) if self._is_detected else 1

    def arrived(self, k: int) -> float:
        return self.samples["shown"].item(k)

    def judged(self, k: int) -> Array:
        return self.samples["judged"][k]

    def received(self, k: int, limits: Envelope | None) -> Sequence[ReceivedExceedance]:
        """Each by the limits in force when it was received."""
        return self._received.get(k, ())

    def attitude(self, k: int) -> Angles:
        """As received; missing angles are integrated from the rates."""
        phi, theta, psi = self.samples["attitude"][k].tolist()
        is_integrated = self.samples["is_integrated"][k]
        return IntegratedAngles(phi, theta, psi) if is_integrated else (phi, theta, psi)

    def _reason(self, k: int) -> str:
        return self.reasons[k]

    def _cause(self, k: int) -> Cause | None:
        return CAUSES[self.samples["cause"][k]]

    def display(self, k: int) -> tuple[Assessment, ...]:
        return self._display[k]

    def _first_of_card(self, k: int) -> int:
        """Each manoeuvre is a card; its forecast begins with the history before it."""
        self._first = int(self._begun[np.searchsorted(self._begun, k, "right") - 1])
        return max(self._first - self._n_history, 0)

    def _of_card(self, k: int) -> Array:
        first = self._first
        return (
            self.y(k) if k >= first else self.recorded(k) - (self.recorded(first) - self.y(first))
        )

    def ruling(self, k: int) -> Ruling | None:
        return self._rulings[k]

    def held_until(self, k: int) -> list[InForceFrom]:
        if all(ruling is None for ruling in self._rulings):
            return []
        changes = [
            (i, ruling)
            for i, ruling in enumerate(self._rulings[: k + 1])
            if i == 0 or ruling is not self._rulings[i - 1]
        ]
        t = self.samples["t"]
        return [InForceFrom(float(t[i]) if i else None, ruling) for i, ruling in changes]

    def doubts(self, k: int) -> tuple[Doubt, ...]:
        return self._doubts[k]

    def late(self, k: int) -> str:
        return self._late[k]

    def stale_after(self, k: int) -> float | None:
        """Time after showing sample k at which the source became stale [s]; None if it did not."""
        if k < 0:
            return None
        shown, wait = self.samples["shown"], stale_after(self.dt)
        following = float(shown[k + 1]) if k + 1 < len(shown) else np.inf
        for i in range(int(np.searchsorted(self._came, shown[k], "right")) - 1, len(self._came)):
            stale = self._came[max(i, 0)] + wait
            if stale >= following:
                return None
            if i + 1 == len(self._came) or self._came[i + 1] > stale:
                return max(0.0, stale - float(shown[k]))
        return None

    def _read(self, setup: LiveSetup, flight_id: str) -> Iterator[tuple[Any, ...]]:
        display, known, scorer = setup.display_attitude(), dict[str, str](), setup.scorer()
        waiting, k = list[ReceivedExceedance](), 0
        for k, assessed in enumerate(rescored(self._lines(setup, flight_id), scorer, setup.reader)):
            waiting += scorer.pop_exceedances()
            until = assessed.assessment.t + self.near
            if due := [sample for sample in waiting if sample.t <= until]:
                self._received[k] = due
                waiting = [sample for sample in waiting if sample.t > until]
            reason = assessed.assessment.reason
            self.reasons.append(known.setdefault(reason, reason))
            self._display.append(assessed.display)
            self._rulings.append(assessed.ruling)
            self._doubts.append(scorer.doubts)
            self._far.append(assessed.far)
            self._late.append(scorer.lag.reason)
            yield _row(assessed, display)
        self.trims = scorer.trims
        if waiting := [*waiting, *scorer.pop_exceedances()]:
            self._received[k] = [*self._received.get(k, ()), *waiting]

    def exceeding(self, limits: Envelope | None) -> Indices:
        """Under the limits in force. limits: the monitor's own."""
        rulings = {id(ruling): ruling for ruling in self._rulings}
        of_sample = np.array([id(ruling) for ruling in self._rulings])
        over = np.zeros(len(self.samples), bool)
        for key, ruling in rulings.items():
            in_force = limits if ruling is None else ruling.limits
            if in_force is not None:
                part = of_sample == key
                y, recorded = self.samples["y"][part], self.samples["recorded"][part]
                over[part] = in_force.exceeds(y) | in_force.exceeds(recorded)
        over[[*self._received]] = True
        return onsets(over)

    def _lines(self, setup: LiveSetup, flight_id: str) -> Iterator[dict[str, Any]]:
        for line in lines_of(setup.journals.path(flight_id)):
            if "b" in line:
                self._came.append(line["a"])
            yield line


def _row(assessed: LiveAssessed, display: DisplayAttitude | None) -> tuple[Any, ...]:
    assessment, attitude = assessed.assessment, assessed.shown_attitude(display)
    return (
        assessed.shown,
        assessment.t,
        assessed.y,
        assessed.judged,
        assessed.recorded,
        np.nan if assessment.p_value is None else assessment.p_value,
        bool(assessment.alert),
        code_of(assessment.state),
        CAUSES.index(assessment.cause),
        np.full(len(assessed.y), np.nan) if assessment.y_hat is None else assessment.y_hat,
        attitude,
        isinstance(attitude, IntegratedAngles),
        assessed.manoeuvre,
    )
