"""Uncertain aircraft: published models, the user's own matrices, identified ones."""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import cos, sin, tan
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np

from core.bounds import Bounds, check_bounds, quoted
from core.channels import KEYS, N_CHANNELS
from core.recipe import family, from_plain
from core.simulation.published import (
    DERIVATIVES,
    MODELS,
    SIGMA_FRACTION,
    AircraftClass,
    ModelName,
    PublishedModel,
    UsualTest,
)
from core.simulation.uncertain_plant import Effect, Plants, UncertainPlant, Uncertainty
from core.types import Array

if TYPE_CHECKING:
    from control import InputOutputSystem

Rows = tuple[tuple[float, ...], ...]

MEASURED, SURFACES = KEYS[:4], KEYS[4:]
NY = KEYS.index("Ny")

OWN_MODEL_TEST = UsualTest("none", doublet_deg=5.4, limit_g=0.5)
PUBLISHED_SCATTER = Uncertainty(dict(SIGMA_FRACTION))
"""The flight-to-flight scatter of identified derivatives, see core.simulation.published."""


class FlightCondition(NamedTuple):
    """About an aircraft and how it flies.

    aircraft_class: its shape, for display.   usual_test: law, rudder doublet and limit.
    altitude: [m], 0 for a sea-level model.   airspeed: true [m/s].   None where unknown.
    """

    aircraft_class: AircraftClass
    usual_test: UsualTest
    altitude: float | None
    airspeed: float | None


@dataclass(frozen=True)
class Aircraft(ABC):
    """The recipe of an uncertain aircraft: a model and its uncertainty."""

    @property
    @abstractmethod
    def description(self) -> str:
        """The aircraft and the source of its numbers, in one line."""

    @property
    @abstractmethod
    def condition(self) -> FlightCondition:
        """Its shape, usual first test and flight condition."""

    @abstractmethod
    def uncertain_plant(self) -> UncertainPlant:
        """The plant and the distribution of its parameters; cheap and deterministic."""


@dataclass(frozen=True)
class PublishedAircraft(Aircraft):
    """A model from the literature with fifteen uncertain stability derivatives.

    beta_dot = Y_beta beta + (sin alpha0 + Y_p) p + (Y_r - cos alpha0) r + (g cos theta0 / V) phi
               + Y_da delta_a + Y_dr delta_r
    N_y = (V / g) (Y_beta beta + Y_p p + Y_r r + Y_da delta_a + Y_dr delta_r)  [g]

    Only the Y, L, N terms are aerodynamic and uncertain; a Y derivative changes beta_dot and N_y
    together. The kinematic terms are exact.
    Raises ValueError for an unknown model, number of states or derivative.
    """

    name: ModelName
    """published model."""
    n_states: Literal[3, 4] = 3
    """number of states: 4 with bank angle phi, or 3 as in the paper; with 3, the Dutch roll is too
    well damped unless g/V is small."""
    uncertainty: Uncertainty = PUBLISHED_SCATTER
    """uncertainty of the derivatives: scatter of each about its nominal value."""

    def __post_init__(self) -> None:
        if self.name not in MODELS:
            raise ValueError(f"no published model {self.name!r}; there are {', '.join(MODELS)}")
        if self.n_states not in (3, 4):
            raise ValueError(f"n_states is {self.n_states}; give 3 (beta, p, r) or 4 (and phi)")
        self.uncertainty.absolute(DERIVATIVES, np.zeros(len(DERIVATIVES)))

    @property
    def model(self) -> PublishedModel:
        return MODELS[self.name]

    @property
    def description(self) -> str:
        """The aircraft, its flight condition, source and check, in one line."""
        model = self.model
        return f"{model.title}, {model.condition}; {model.reference}; {model.checked}"

    @property
    def condition(self) -> FlightCondition:
        model = self.model
        return FlightCondition(model.aircraft_class, model.usual_test, model.altitude, model.speed)

    def uncertain_plant(self) -> UncertainPlant:
        """The derivatives with their distribution, in the order of published.DERIVATIVES."""
        nominal = np.array(self.model.Y + self.model.L + self.model.N)
        return UncertainPlant(
            states=("beta", "p", "r", "phi")[: self.n_states],
            names=DERIVATIVES,
            nominal=nominal,
            spread=self.uncertainty.absolute(DERIVATIVES, nominal),
            distribution=self.uncertainty.distribution,
            fixed=_kinematics(self.model, self.n_states),
            effects=_derivative_effects(self.model.speed / self.model.gravity),
        )


def _kinematics(model: PublishedModel, n_states: int) -> Plants:
    """The part of a published model fixed by geometry and gravity; outputs are states, surfaces."""
    weight = model.phi_to_beta
    if weight is None:
        weight = model.gravity * cos(model.theta0) / model.speed
    climb = model.r_to_phi if model.r_to_phi is not None else tan(model.theta0)
    a = np.zeros((1, 4, 4))
    a[0, 0] = 0.0, sin(model.alpha0), -cos(model.alpha0), weight
    a[0, 3] = 0.0, 1.0, climb, 0.0
    c = np.zeros((1, N_CHANNELS, n_states))
    c[0, :3, :3] = np.eye(3)
    d = np.zeros((1, N_CHANNELS, 2))
    d[0, 4:] = np.eye(2)
    reduced = np.ascontiguousarray(a[:, :n_states, :n_states])
    return Plants(reduced, np.zeros((1, n_states, 2)), c, d)


def _derivative_effects(speed_over_gravity: float) -> tuple[Effect, ...]:
    """Y, L, N are rows 0-2 of A and B; Y times V/g is also the N_y row of C and D."""
    effects: list[Effect] = []
    for parameter in range(len(DERIVATIVES)):
        row, cause = divmod(parameter, 5)
        of_input, column = (0, cause) if cause < 3 else (1, cause - 3)
        effects.append(Effect(of_input, row, column, parameter, 1.0))
        if row == 0:
            effects.append(Effect(2 + of_input, NY, column, parameter, speed_over_gravity))
    return tuple(effects)


@dataclass(frozen=True)
class MatrixAircraft(Aircraft):
    """The user's own linear model: nominal matrices and the uncertainty of their entries.

    Inputs delta_a, delta_r [rad]; outputs beta [rad], p, r [rad/s], Ny [g]. a (nx, nx), b (nx, 2),
    c (4, nx), d (4, 2), any nx >= 1 with any states.
    Raises ValueError for wrong shapes, non-finite numbers, missing entries, and fractions of zero.
    """

    a: Rows
    """state matrix A: angles [rad] and rates [rad/s], one row and one column for each state."""
    b: Rows
    """input matrix B: one row for each state, columns delta_a and delta_r [rad] in this order."""
    c: Rows
    """output matrix C: rows beta [rad], p, r [rad/s] and Ny [g], in this order; the surfaces are
    appended. With 6 rows, the last two must be the surfaces: zeros in c, identity in d."""
    d: Rows
    """feedthrough matrix D: rows beta [rad], p, r [rad/s] and Ny [g], as in C; the surfaces are
    appended. With 6 rows, the last two must be the surfaces: zeros in c, identity in d."""
    uncertainty: Uncertainty
    """uncertainty of the entries: by entry, as {"A[0,0]": 0.1, "C[3,0]": 0.1} (row, column, from 0;
    not the surfaces' rows). One number means every entry that is not 0, 1 or -1, including
    kinematic ones such as cos(alpha0). Entries vary independently, even where beta_dot and N_y
    share a derivative."""
    states: tuple[str, ...] = ()
    """names of the states: none for x0, x1 and so on. A law that feeds back bank angle needs
    "phi"."""
    altitude_m: Annotated[float | None, Bounds(least=0)] = None
    """altitude of the flight condition: 0 for a sea-level model [m]; gusts depend on it."""
    airspeed_mps: Annotated[float | None, Bounds(above=0)] = None
    """true airspeed of the flight condition [m/s]: gusts depend on it, and recorded airspeed is
    compared with it."""

    def __post_init__(self) -> None:
        check_bounds(self)
        self.uncertain_plant()

    @classmethod
    def from_json(cls, document: Any) -> Self:
        """From parsed JSON; keys are the fields, matrices (capital or not) as lists of rows.

            {"states": ["beta", "p", "r"],
             "A": [[...], ...], "B": [[...], ...], "C": [[...], ...], "D": [[...], ...],
             "uncertainty": {"distribution": "normal", "unit": "fraction",
                             "spread": {"A[0,0]": 0.1, "B[2,1]": 0.15}}}

        `states`, `distribution` and `unit` are optional; `spread` may be one number. Optional too:
        `altitude_m`, `airspeed_mps` and, as in recipes, `kind`.
        """
        given = document if isinstance(document, dict) else {}
        fields = {"states": []} | {key.lower(): value for key, value in given.items()}
        scatter, states = fields.get("uncertainty"), fields["states"]
        if not (fields.keys() >= set("abcd") and isinstance(scatter, dict) and "spread" in scatter):
            raise ValueError(
                f"a model is {quoted(document)}: give a JSON object with A, B, C, D and "
                "uncertainty with its spread; states, altitude_m and airspeed_mps are optional"
            )
        if not isinstance(states, list) or not all(isinstance(name, str) for name in states):
            raise ValueError(f"states is {quoted(states)}; give a list of names")
        fields |= {key: _rows(key.upper(), fields[key]) for key in "abcd"} | {"kind": "matrices"}
        return from_plain(AIRCRAFT["matrices"], fields, "the model")

    @classmethod
    def from_statespace(cls, system: "InputOutputSystem", uncertainty: Uncertainty) -> Self:
        """From python-control: continuous time, inputs delta_a, delta_r, outputs beta, p, r, Ny.

        Signals labelled as in core.channels are found by label; other outputs are ignored.
        Unlabelled ones (u[0], y[0], ...) are taken in that order, with or without the surfaces.
        """
        from control import StateSpace

        if not isinstance(system, StateSpace):
            raise ValueError(
                f"a {type(system).__name__} was given; convert it with control.ss first"
            )
        if not system.isctime():
            raise ValueError(
                f"the model is sampled every {system.dt} s; give it in continuous time"
            )
        inputs = _signals("inputs", system.input_labels, "u", (SURFACES,))
        outputs = _signals("outputs", system.output_labels, "y", (KEYS, MEASURED))
        a, b, c, d = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
        return cls(
            _rows("A", a),
            _rows("B", b[:, inputs]),
            _rows("C", c[outputs]),
            _rows("D", d[np.ix_(outputs, inputs)]),
            uncertainty,
            tuple(system.state_labels),
        )

    @property
    def description(self) -> str:
        """Its name in lists, and its size."""
        return f"Your own model (matrices); {len(self.a)} states"

    @property
    def condition(self) -> FlightCondition:
        """Drawn as a fighter; the test suits the example, other models need their own."""
        return FlightCondition("fighter", OWN_MODEL_TEST, self.altitude_m, self.airspeed_mps)

    def uncertain_plant(self) -> UncertainPlant:
        """The uncertain entries as parameters, named as in the uncertainty."""
        matrices = self._matrices()
        names = self._uncertain_names(matrices)
        places = [_place(name, matrices) for name in names]
        nominal = np.array([matrices[m][row, column] for m, row, column in places])
        spread = self.uncertainty.absolute(names, nominal)
        asked = self.uncertainty.absolute(names, np.ones(len(names)))
        for name in np.array(names)[(asked > 0.0) & (spread == 0.0)]:
            raise ValueError(
                f"{name} is 0 and a fraction of 0 does not vary; give an absolute spread"
            )
        for matrix, row, column in places:
            matrices[matrix][row, column] = 0.0
        return UncertainPlant(
            states=self.states or tuple(f"x{i}" for i in range(len(self.a))),
            names=names,
            nominal=nominal,
            spread=spread,
            distribution=self.uncertainty.distribution,
            fixed=Plants(*(matrix[np.newaxis] for matrix in matrices)),
            effects=tuple(Effect(*place, k, 1.0) for k, place in enumerate(places)),
        )

    def _matrices(self) -> Plants:
        """A, B, C, D, checked, with the surfaces' rows, without the batch axis."""
        a, b, c, d = (
            np.array(_rows(name, rows), dtype=np.float64)
            for name, rows in zip("ABCD", (self.a, self.b, self.c, self.d), strict=True)
        )
        nx = len(a)
        n_outputs = len(c) if len(c) in (len(MEASURED), N_CHANNELS) else len(MEASURED)
        needs = ("A", a, (nx, nx)), ("B", b, (nx, 2)), ("C", c, (n_outputs, nx))
        for name, matrix, shape in (*needs, ("D", d, (n_outputs, 2))):
            if matrix.shape != shape:
                raise ValueError(
                    f"{name} is {_by(matrix.shape)}; with {nx} states it needs {_by(shape)}"
                    + " (rows beta, p, r, Ny)" * (name in "CD")
                )
        if self.states and len(self.states) != nx:
            raise ValueError(f"{len(self.states)} states are named; A is {_by(a.shape)}")
        own_c, own_d = np.zeros((2, nx)), np.eye(2)
        if n_outputs == N_CHANNELS:
            if not (np.array_equal(c[4:], own_c) and np.array_equal(d[4:], own_d)):
                raise ValueError(
                    "rows 4 and 5 of C and D are not delta_a and delta_r themselves (C 0, D "
                    "identity); leave them out, and model the actuators in the control law"
                )
            return Plants(a, b, c, d)
        return Plants(a, b, np.vstack((c, own_c)), np.vstack((d, own_d)))

    def _uncertain_names(self, matrices: Plants) -> tuple[str, ...]:
        if isinstance(self.uncertainty.spread, dict):
            return tuple(self.uncertainty.spread)
        return tuple(
            f"{name}[{row},{column}]"
            for name, matrix in zip("ABCD", matrices, strict=True)
            for row, column in np.argwhere(~np.isin(matrix, (0.0, 1.0, -1.0)))
        )


def _place(name: str, matrices: Plants) -> tuple[int, int, int]:
    """Matrix, row and column of an entry called e.g. "A[0,1]"."""
    nx = len(matrices.a)
    limits = {"A": (nx, nx), "B": (nx, 2), "C": (len(MEASURED), nx), "D": (len(MEASURED), 2)}
    match = re.fullmatch(r"([ABCD])\[(0|[1-9]\d*),(0|[1-9]\d*)\]", name)
    if match:
        letter, row, column = match[1], int(match[2]), int(match[3])
        if row < limits[letter][0] and column < limits[letter][1]:
            return "ABCD".index(letter), row, column
    sizes = ", ".join(f"{letter} {_by(shape)}" for letter, shape in limits.items())
    raise ValueError(
        f"{name!r} is not an entry that can vary; write it like A[0,1], counted from 0, within "
        f"{sizes}"
    )


def _rows(name: str, matrix: Any) -> Rows:
    """A matrix given as rows or as an array, as tuples of floats; all numbers finite."""
    try:
        array = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != 2 or array.size == 0:
        raise ValueError(f"{name} is {quoted(matrix)}; give a list of rows of equally many numbers")
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"{name}[{row},{column}] is {array[row, column]}; give a finite number")
    return tuple(tuple(float(number) for number in array[i]) for i in range(len(array)))


def _signals(
    kind: str, labels: list[str], default: str, choices: tuple[tuple[str, ...], ...]
) -> list[int]:
    """Positions of the first complete set of signals: by label, or unlabelled in order."""
    unlabelled = labels == [f"{default}[{i}]" for i in range(len(labels))]
    for keys in choices:
        if set(keys) <= set(labels):
            return [labels.index(key) for key in keys]
        if unlabelled and len(labels) == len(keys):
            return list(range(len(keys)))
    raise ValueError(
        f"the model's {kind} are {', '.join(labels)}; label them {', '.join(choices[-1])}, or give "
        "them unlabelled in that order"
    )


def _by(shape: tuple[int, ...]) -> str:
    return " by ".join(map(str, shape))


def _example() -> MatrixAircraft:
    """The F-16's 3-state matrices and scatter, entry by entry, as an example to overwrite."""
    plant = PublishedAircraft("f16_sl_h0_v502").uncertain_plant()
    a, b, c, d = (np.round(matrix[0], 6) for matrix in plant.nominal_plant())
    scatter = {
        f"{'ABCD'[matrix]}[{row},{column}]": SIGMA_FRACTION[plant.names[parameter]]
        for matrix, row, column, parameter, _ in plant.effects
        if plant.fixed[matrix][0, row, column] == 0.0  # not where kinematics dominate the entry
    }
    return MatrixAircraft(
        _rows("A", a),
        _rows("B", b),
        _rows("C", c[: len(MEASURED)]),
        _rows("D", d[: len(MEASURED)]),
        Uncertainty(scatter),
        plant.states,
    )


@dataclass(frozen=True)
class IdentifiedAircraft(Aircraft):
    """An aircraft identified from flights: mean and full covariance of its parameters.

    Raises ValueError for a mean and a covariance that do not fit the aircraft's parameters.
    """

    base: Aircraft
    """aircraft before identification: its model, class and flight condition."""
    mean: tuple[float, ...]
    """mean of each parameter, in the order of the model's."""
    covariance: Rows
    """covariance of the parameters: one row for each."""
    sources: tuple[str, ...] = ()
    """flights used for identification."""

    def __post_init__(self) -> None:
        n = len(self.base.uncertain_plant().names)
        mean, covariance = np.array(self.mean), np.array(self.covariance)
        if mean.shape != (n,) or covariance.shape != (n, n):
            raise ValueError(
                f"mean has shape {mean.shape} and covariance {covariance.shape}: the aircraft has "
                f"{n} parameters"
            )
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise ValueError("mean or covariance holds a non-finite number")
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        scaled = covariance / np.outer(*(2 * (np.where(deviation > 0.0, deviation, 1.0),)))
        if not np.allclose(scaled, scaled.T) or np.linalg.eigvalsh(scaled).min() < -1e-6:
            raise ValueError("covariance is not symmetric and positive")

    @classmethod
    def of(
        cls, base: Aircraft, mean: Array, covariance: Array, sources: tuple[str, ...] = ()
    ) -> Self:
        """From mean (n_params,) and covariance (n_params, n_params)."""
        rows = 0.5 * (covariance + covariance.T)
        return cls(base, tuple(mean.tolist()), tuple(map(tuple, rows.tolist())), sources)

    @classmethod
    def undetermined(cls, base: Aircraft) -> Self:
        """The aircraft before any flight."""
        plant = base.uncertain_plant()
        return cls.of(base, plant.nominal, plant.root @ plant.root.T)

    @property
    def description(self) -> str:
        return f"{self.base.description}; identified from {', '.join(self.sources) or 'no flight'}"

    @property
    def condition(self) -> FlightCondition:
        return self.base.condition

    def uncertain_plant(self) -> UncertainPlant:
        """The model's parameters with their joint distribution."""
        covariance = np.array(self.covariance)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        uncertain = np.flatnonzero(deviation)
        scale = deviation[uncertain]
        sizes, ways = np.linalg.eigh(covariance[uncertain][:, uncertain] / np.outer(scale, scale))
        root = np.zeros((len(deviation), len(uncertain)))
        root[uncertain] = scale[:, np.newaxis] * ways * np.sqrt(np.maximum(sizes, 0.0))
        return replace(
            self.base.uncertain_plant(),
            nominal=np.array(self.mean),
            spread=deviation,
            distribution="normal",
            joint_root=root,
        )


AIRCRAFT = family(
    "aircraft",
    Aircraft,
    {
        **{name: PublishedAircraft(name) for name in MODELS},
        "matrices": _example(),
    },
    made={"identified": IdentifiedAircraft.undetermined(PublishedAircraft("attas_id_16kft"))},
)
