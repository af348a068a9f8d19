"""Actuators and feedback laws: from pilot commands and measurements to the surfaces.

u_cmd = pilot (after the pedals' lag) - K(s) y; each surface: delta_dot = bandwidth (u_cmd - delta).
y = (beta, p, r, Ny, delta_a, delta_r, phi), in rad, rad/s and g.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import exp, isfinite
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.recipe import family
from core.simulation.uncertain_plant import Plants, UncertainPlant
from core.types import Array

if TYPE_CHECKING:
    from control import InputOutputSystem

Rows = tuple[tuple[float, ...], ...]

FEEDBACK: tuple[str, ...] = (*KEYS, "phi")
"""Possible feedback; phi only if it is the plant's fourth state."""
SURFACES: tuple[str, ...] = KEYS[4:]
PHI_STATE = 3
POSITIVE = Bounds(above=0, words="give a finite number above zero, or none for no limit")
LARGEST_GROWTH = 1e3
"""Largest permitted growth of the nominal closed loop over a manoeuvre."""


@dataclass(frozen=True)
class Actuator:
    """First-order surface actuator 20.2/(s + 20.2), both surfaces alike (Stevens and Lewis, F-16).

    With a limit, rollouts are integrated numerically instead of exactly.
    Raises ValueError for numbers that are not positive and finite.
    """

    bandwidth_rad_s: Annotated[float, POSITIVE] = 20.2
    """bandwidth of the actuators [rad/s]."""
    rate_limit_deg_s: Annotated[float | None, POSITIVE] = None
    """largest surface rate [deg/s]; None: no limit."""
    position_limit_deg: Annotated[float | None, POSITIVE] = None
    """largest command [deg]; None: no limit."""

    def __post_init__(self) -> None:
        check_bounds(self)


class Controller(NamedTuple):
    """K(s) as state space: a (m, m), b (m, 7), c (2, m), d (2, 7); inputs FEEDBACK, outputs K y."""

    a: Array
    b: Array
    c: Array
    d: Array


@dataclass(frozen=True, kw_only=True)
class ControlLaw(ABC):
    """The recipe of a feedback law with its actuators."""

    actuator: Actuator = Actuator()
    """surface actuators: first order, both surfaces alike, with limits if any."""

    @abstractmethod
    def controller(self, plant: UncertainPlant) -> Controller:
        """K(s) for this aircraft; ValueError if the plant lacks a needed state."""


def _checked(controller: Controller, plant: UncertainPlant) -> Controller:
    """ValueError for feedback of bank angle if the plant does not have it."""
    uses_phi = controller.b[:, -1].any() or controller.d[:, -1].any()
    if uses_phi and (len(plant.states) <= PHI_STATE or plant.states[PHI_STATE] != "phi"):
        raise ValueError(
            "the control law feeds back phi, but the plant's states are "
            f"{', '.join(plant.states)}; choose an aircraft whose fourth state is phi, or a law "
            "without phi"
        )
    return controller


@dataclass(frozen=True, kw_only=True)
class NoFeedback(ControlLaw):
    """The pilot alone moves the surfaces."""

    def controller(self, plant: UncertainPlant) -> Controller:
        return Controller(np.zeros((0, 0)), np.zeros((0, 7)), np.zeros((2, 0)), np.zeros((2, 7)))


def _washed_out(gains: Array, washout_rad_s: float) -> Controller:
    """K y = gains (r_w, p, beta, phi), r_w = s/(s + washout) r; gains (2, 4)."""
    if not (isfinite(washout_rad_s) and washout_rad_s > 0):
        raise ValueError(
            f"washout_rad_s is {washout_rad_s}; give a finite corner frequency above zero"
        )
    if not np.isfinite(gains).all():
        raise ValueError("the control law's gains are not all finite; give finite numbers")
    b = np.zeros((1, 7))
    b[0, FEEDBACK.index("r")] = washout_rad_s
    d = np.zeros((2, 7))
    for column, key in enumerate(("r", "p", "beta", "phi")):
        d[:, FEEDBACK.index(key)] = gains[:, column]
    # s/(s + w) r is r minus r through the low pass w/(s + w), which is the state
    return Controller(np.array([[-washout_rad_s]]), b, -gains[:, :1], d)


@dataclass(frozen=True, kw_only=True)
class OutputFeedback(ControlLaw):
    """Output feedback u = pilot - K (r_w, p, beta, phi), r_w = s/(s + washout) r, angles alike.

    The default is the F-16's lateral regulator of Stevens, Lewis and Johnson, Aircraft Control and
    Simulation, 3rd ed., Example 5.3-1; it needs the four-state plant.
    """

    aileron: tuple[float, float, float, float] = (-0.56, -0.44, 0.11, -0.35)
    """aileron gains: row of K, gains of r_w, p, beta and phi."""
    rudder: tuple[float, float, float, float] = (-1.19, -0.21, -0.44, 0.26)
    """rudder gains: row of K, gains of r_w, p, beta and phi."""
    washout_rad_s: float = 1.0
    """washout corner of the yaw rate: slower turns are not fed back [rad/s]."""

    def controller(self, plant: UncertainPlant) -> Controller:
        gains = np.array([self.aileron, self.rudder])
        if gains.shape != (2, 4):
            raise ValueError("aileron and rudder need four gains each, of r, p, beta and phi")
        return _checked(_washed_out(gains, self.washout_rad_s), plant)


@dataclass(frozen=True, kw_only=True)
class RateDamper(ControlLaw):
    """Washed-out yaw damper and roll damper: rudder +-kr s/(s + washout) r, aileron +-kp p.

    Signs damp the nominal aircraft, given the surface's effect on the rate; a negative gain reduces
    damping.
    """

    kr: float = 0.5
    """yaw damper gain k_r: rudder per washed-out yaw rate [s]."""
    kp: float = 0.1
    """roll damper gain k_p: aileron per roll rate [s]."""
    washout_rad_s: float = 1.0
    """washout corner of the yaw rate: slower turns are not fed back [rad/s]."""
    made_for: str = ""
    """gains chosen for: an aircraft; a remark."""

    def controller(self, plant: UncertainPlant) -> Controller:
        """K(s) with one state; ValueError if a surface does not change its rate."""
        nominal = plant.nominal_plant()
        effect = (nominal.c[0] @ nominal.b[0])[[KEYS.index("p"), KEYS.index("r")], [0, 1]]
        for gain, value, words in (
            (self.kp, effect[0], "aileron does not change the roll rate"),
            (self.kr, effect[1], "rudder does not change the yaw rate"),
        ):
            if gain != 0.0 and value == 0.0:
                raise ValueError(
                    f"the {words} of this aircraft, so its damper has no sign; set that gain to 0"
                )
        aileron, rudder = np.sign(effect)
        gains = np.array([[0.0, aileron * self.kp, 0.0, 0.0], [rudder * self.kr, 0.0, 0.0, 0.0]])
        return _checked(_washed_out(gains, self.washout_rad_s), plant)


@dataclass(frozen=True, kw_only=True)
class StateSpaceLaw(ControlLaw):
    """The user's own K(s) as matrices: u_cmd = pilot - K y.

    a (m, m), b (m, inputs), c (outputs, m), d (outputs, inputs); a, b empty for constant gains.
    Raises ValueError for names that are unknown or repeated, wrong shapes and non-finite numbers.
    """

    inputs: tuple[str, ...] = ("r",)
    """channels fed back: of beta, p, r, Ny, delta_a, delta_r and phi."""
    outputs: tuple[str, ...] = ("delta_r",)
    """surfaces moved: delta_a, delta_r or both."""
    a: Rows = ((-1.0,),)
    """state matrix A of the law."""
    b: Rows = ((1.0,),)
    """input matrix B of the law."""
    c: Rows = ((0.5,),)
    """output matrix C of the law."""
    d: Rows = ((-0.5,),)
    """feedthrough matrix D of the law."""

    def __post_init__(self) -> None:
        _check_names("input", self.inputs, FEEDBACK)
        _check_names("output", self.outputs, SURFACES)
        self._matrices()

    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        m, n_in, n_out = len(self.a), len(self.inputs), len(self.outputs)
        shapes = {"a": (m, m), "b": (m, n_in), "c": (n_out, m), "d": (n_out, n_in)}
        matrices = []
        for name, shape in shapes.items():
            rows = getattr(self, name)
            given = {(len(rows), len(row)) for row in rows} or {(0, shape[1])}
            if given != {shape} and not (0 in shape and all(len(row) == 0 for row in rows)):
                raise ValueError(
                    f"matrix {name} of the control law has the shape {sorted(given)}; with "
                    f"{m} states, {n_in} inputs and {n_out} outputs it needs {shape}"
                )
            matrix = np.array(rows, dtype=np.float64).reshape(shape)
            if not np.isfinite(matrix).all():
                raise ValueError(f"matrix {name} of the control law needs finite numbers")
            matrices.append(matrix)
        a, b, c, d = matrices
        return a, b, c, d

    def controller(self, plant: UncertainPlant) -> Controller:
        a, b, c, d = self._matrices()
        columns = [FEEDBACK.index(name) for name in self.inputs]
        rows = [SURFACES.index(name) for name in self.outputs]
        full = Controller(
            a, np.zeros((len(a), 7)), np.zeros((2, len(a))), np.zeros((2, len(FEEDBACK)))
        )
        full.b[:, columns] = b
        full.c[rows] = c
        full.d[np.ix_(rows, columns)] = d
        return _checked(full, plant)

    @classmethod
    def from_lti(
        cls,
        system: "InputOutputSystem",
        *,
        inputs: tuple[str, ...] | None = None,
        outputs: tuple[str, ...] | None = None,
        actuator: Actuator = Actuator(),
    ) -> Self:
        """From a python-control transfer function or state space, continuous in time.

        inputs, outputs: signal names, the system's own labels if not given. A transfer matrix is
        realised entry by entry. ValueError for discrete time and improper transfer functions.
        """
        from control import StateSpace, TransferFunction

        if not isinstance(system, StateSpace | TransferFunction):
            raise ValueError(
                f"the control law is a {type(system).__name__}; give a continuous-time "
                "python-control transfer function (tf) or state space (ss)"
            )
        if system.isdtime(strict=True):
            raise ValueError(
                f"the control law is discrete in time (dt={system.dt}); convert it to "
                "continuous time, for example by its bilinear inverse"
            )
        a, b, c, d = (
            (system.A, system.B, system.C, system.D)
            if isinstance(system, StateSpace)
            else _realise(system)
        )
        return cls(
            actuator=actuator,
            inputs=tuple(system.input_labels if inputs is None else inputs),
            outputs=tuple(system.output_labels if outputs is None else outputs),
            a=_rows(a),
            b=_rows(b),
            c=_rows(c),
            d=_rows(d),
        )


def _check_names(kind: str, names: tuple[str, ...], known: tuple[str, ...]) -> None:
    if not names or len(set(names)) < len(names) or not set(names) <= set(known):
        raise ValueError(
            f"the control law's {kind}s are {', '.join(names) or 'none'}; name each {kind} once, "
            f"from {', '.join(known)}"
        )


def _rows(matrix: npt.ArrayLike) -> Rows:
    return tuple(tuple(float(x) for x in row) for row in np.asarray(matrix))


def _realise(system: Any) -> tuple[Array, Array, Array, Array]:
    """State space of a transfer matrix, realised entry by entry."""
    from scipy.linalg import block_diag
    from scipy.signal import tf2ss

    n_out, n_in = system.noutputs, system.ninputs
    blocks, columns, rows = [], [], []
    d = np.zeros((n_out, n_in))
    for i in range(n_out):
        for j in range(n_in):
            numerator = np.trim_zeros(np.atleast_1d(system.num[i][j]), "f")
            denominator = np.trim_zeros(np.atleast_1d(system.den[i][j]), "f")
            if len(numerator) > len(denominator):
                raise ValueError(
                    f"the control law from {system.input_labels[j]} to {system.output_labels[i]} "
                    f"is improper (order {len(numerator) - 1} over {len(denominator) - 1}); add "
                    "poles until the denominator's order is at least the numerator's"
                )
            if len(numerator) == 0:
                continue
            if len(denominator) == 1:
                d[i, j] = numerator[0] / denominator[0]
                continue
            entry_a, entry_b, entry_c, entry_d = tf2ss(numerator, denominator)
            blocks.append(entry_a)
            columns.append(entry_b * np.eye(n_in)[j])
            rows.append(np.eye(n_out)[:, i : i + 1] * entry_c)
            d[i, j] = entry_d[0, 0]
    a = np.asarray(block_diag(np.zeros((0, 0)), *blocks))
    b = np.concatenate([np.zeros((0, n_in)), *columns])
    return a, b, np.concatenate([np.zeros((n_out, 0)), *rows], axis=1), d


def measured_rows(plants: Plants) -> Array:
    """(n, 7, nx + 2) FEEDBACK of plants by their states, delta_a and delta_r."""
    n, nx = plants.a.shape[:2]
    measured = np.zeros((n, len(FEEDBACK), nx + 2))
    measured[:, :4] = np.concatenate([plants.c[:, :4], plants.d[:, :4]], axis=2)
    measured[:, 4:6, nx:] = np.eye(2)
    measured[:, 6, PHI_STATE : PHI_STATE + 1] = float(nx > PHI_STATE)
    return measured


def closed_loops(plants: Plants, controller: Controller, actuator: Actuator) -> tuple[Array, Array]:
    """F (n, k, k) and G (k, 2) of z_dot = F z + G pilot for n plants, without lag and limits.

    z = (plant states, delta_a, delta_r, controller states).
    """
    n, nx, m = *plants.a.shape[:2], len(controller.a)
    measured = measured_rows(plants)
    loops = np.zeros((n, nx + 2 + m, nx + 2 + m))
    motion, surfaces, law = loops[:, :nx], loops[:, nx : nx + 2], loops[:, nx + 2 :]
    motion[..., :nx], motion[..., nx : nx + 2] = plants.a, plants.b
    surfaces[..., : nx + 2] = -controller.d @ measured
    surfaces[..., nx + 2 :] = -controller.c
    surfaces[..., nx : nx + 2] -= np.eye(2)
    surfaces *= actuator.bandwidth_rad_s
    law[..., : nx + 2], law[..., nx + 2 :] = controller.b @ measured, controller.a
    drive = np.zeros((nx + 2 + m, 2))
    drive[nx : nx + 2] = actuator.bandwidth_rad_s * np.eye(2)
    return loops, drive


def check_usable(
    plant: UncertainPlant, controller: Controller, actuator: Actuator, duration_s: float
) -> None:
    """ValueError if the nominal closed loop grows beyond LARGEST_GROWTH within the manoeuvre.

    A mildly unstable spiral passes.
    """
    (loop,), _ = closed_loops(plant.nominal_plant(), controller, actuator)
    poles = np.linalg.eigvals(loop)
    worst = poles[np.argmax(poles.real)]
    if worst.real * duration_s > np.log(LARGEST_GROWTH):
        frequency = f" {abs(worst.imag):+.3g}j" if worst.imag else ""
        growth = f"by {exp(min(worst.real * duration_s, 700.0)):.0e} within {duration_s:g} s"
        raise ValueError(
            f"the nominal closed loop has a pole at {worst.real:.3g}{frequency} rad/s and grows "
            f"{growth}; check the law's signs (u = pilot - K y), lower its gains, or choose a "
            "stabilising law"
        )


CONTROL_LAWS = family(
    "control_law",
    ControlLaw,
    {
        "none": NoFeedback(),
        "f16_sl_ofb": OutputFeedback(),
        "f16_damper": RateDamper(kr=0.5, kp=0.1, made_for="F-16"),
        "f104a_damper": RateDamper(kr=0.3, kp=0.03, made_for="F-104A"),
        "f4c_damper": RateDamper(kr=1.0, kp=0.1, made_for="F-4C"),
        "attas_damper": RateDamper(kr=1.0, kp=0.1, made_for="ATTAS"),
        "nt33a_damper": RateDamper(kr=1.0, kp=0.1, made_for="NT-33A"),
        # MathWorks, Control System Toolbox, "Yaw Damper Design for a 747 Jet Aircraft"
        "b747_yaw_damper_mathworks": RateDamper(
            kr=2.34, kp=0.0, washout_rad_s=0.2, made_for="Boeing 747"
        ),
        # after Bryson; Franklin, Powell and Emami-Naeini's 747
        "b747_yaw_damper_bryson": RateDamper(
            kr=2.0, kp=0.0, washout_rad_s=1.0 / 3.0, actuator=Actuator(10.0), made_for="Boeing 747"
        ),
        "state_space": StateSpaceLaw(),
    },
)
