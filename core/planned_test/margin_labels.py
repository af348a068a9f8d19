"""A planned test whose rollouts fail where the closed loop of their aircraft has too little margin.

A margin is a property of the aircraft, unknown in flight: it labels rollouts, at their last sample,
and no sample of a flight can be judged by it. A monitor learns to warn before the manoeuvre ends.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from core.planned_test.nonlinear_test import NonlinearTest
from core.planned_test.own import OwnSimulator, OwnTest
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest
from core.seeds import Branch, stream
from core.simulation.simulator import Rollouts
from core.simulation.stability_margins import Margins, stability_margins
from core.types import Array

PILOT_AIRCRAFT = 100
"""Aircraft whose margins an error names."""
Kind = Literal["gain", "phase", "disk"]
UNITS: dict[str, str] = {"gain": "dB", "phase": "deg", "disk": ""}


class MarginBound(NamedTuple):
    """An aircraft with less than this is unsafe.   least: [dB], [deg], or of a disk."""

    kind: Kind
    least: float

    @property
    def text(self) -> str:
        return f"{self.kind} margin > {self.least:g} {UNITS[self.kind]}".rstrip()


class MarginSimulator:
    """Flies a planned test, and labels the rollouts by the margins of their aircraft."""

    def __init__(self, planned: ManeuverTest, bounds: Sequence[MarginBound]):
        """ValueError if the closed loop is not known here."""
        if not isinstance(planned, DatasetRecipe | NonlinearTest):
            raise ValueError(
                "stability margins need a closed loop that is known here, and this aircraft has "
                "its own flight controls: choose a linear or nonlinear aircraft"
            )
        self._simulator, self._bounds = planned.simulator(), bounds
        self._actuator = planned.control_law.actuator
        self.dictionary = self._simulator.dictionary
        self.parameters, self.dt = self._simulator.parameters, planned.dt
        self.about = {"planned": planned.to_plain()}

    def rollouts(self, n: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        return self._labelled(self._simulator.rollouts(n, rng))

    def fly(self, theta: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        return self._labelled(self._simulator.fly(theta, rng)[0])

    def margins(self, theta: Array) -> Margins:
        """Margins of aircraft theta (n, n_parameters)."""
        plants = self._simulator.plants(theta)
        return stability_margins(plants, self._simulator.controller, self._actuator)

    def _labelled(self, rollouts: Rollouts) -> tuple[Array, Array, Array]:
        y, _, theta = rollouts
        margins = self.margins(theta)._asdict()
        unsafe = np.any([margins[kind] <= least for kind, least in self._bounds], axis=0)
        measured = [self.dictionary.index(key) for key in self.dictionary.measured]
        return y[..., measured], np.where(unsafe, y.shape[1] - 1, -1), theta


def labelled_by_margins(planned: ManeuverTest, bounds: Sequence[MarginBound]) -> OwnTest:
    """The test with the sizes of the planned one, its limits left out.   ValueError."""
    own = MarginSimulator(planned, bounds)
    rng = stream(planned.seed, Branch.PILOT_RUN)
    margins = own.margins(own.parameters.sample(PILOT_AIRCRAFT, rng))._asdict()
    ranges = []
    for kind in dict.fromkeys(bound.kind for bound in bounds):
        low, high = float(margins[kind].min()), float(margins[kind].max())
        ranges.append(f"{kind} margins of {low:.3g} to {high:.3g} {UNITS[kind]}".rstrip())
        if low == np.inf:
            raise ValueError(
                f"no change of {kind} makes any of these aircraft unstable, with this control law: "
                "choose another margin or a law with feedback"
            )
    plain = planned.to_plain()
    name = ", ".join(plain[part]["kind"] for part in ("aircraft", "control_law", "maneuver"))
    words = " and ".join(bound.text for bound in bounds)
    n_samples = planned.maneuver.n_samples(planned.dt)
    simulator = replace(
        OwnSimulator.of(own, name), specification=f"requirement {words}", n_samples=n_samples
    )
    return OwnTest(
        simulator,
        n_unsafe=planned.n_unsafe,
        n_obs=planned.n_obs,
        seed=planned.seed,
        max_rollouts=planned.max_rollouts,
        max_safe=planned.max_safe,
        pilot=f"the first {PILOT_AIRCRAFT} aircraft have {' and '.join(ranges)}: ",
        more="raise the bound",
        fewer="lower the bound",
    )
