"""Aircraft of JSBSim (extra `jsbsim`), with every aerodynamic function made uncertain.

The aircraft's file is edited in the folder of a process; JSBSim's own files stay as they are.
"""

import shutil
import tempfile
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from math import ceil, cos, degrees, radians, sin
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from core.bounds import NOT_NEGATIVE, Bounds, check_bounds
from core.recipe import family, instead_of
from core.simulation.flight_process import Fly
from core.simulation.point import POSITIVE, Breakpoints, PointRecipe
from core.simulation.published import FOOT, AircraftClass
from core.simulation.python_simulator import ImpossibleError
from core.simulation.simulator import Parameters
from core.types import Array

if TYPE_CHECKING:  # slow to import in each process of a model
    from core.kernels.six_dof import FlightPoint

LARGEST_STEP = 0.005
"""Step of integration [s]; with longer ones the peaks depend on it."""
FULL_TRIM, TURN_TRIM, WITHOUT_INITIAL_RUN = 1, 5, 2
ON_GROUND = "pushback", "hook", "catapult", "holdback"
"""Systems that take time and do nothing in flight."""
FACTOR = "factor/"
"""Before the name of a function: the property that multiplies it."""
JET, LIGHT = (5000.0, 0.6), (1500.0, 0.165)
USUALLY: dict[tuple[float, float], str] = {
    JET: "737 787-8 A320 A4 B747 Concorde F4N MD11 T38 XB-70 f15 f16 fokker100 global5000",
    LIGHT: "Boeing314 DHC6 T37 c172p c172r c172x c182 pa28 t6texan2",
    (1500.0, 0.1): "Camel J3Cub",
    (3000.0, 0.3): "OV10 c310",
    (3000.0, 0.45): "F80C",
}
"""Altitude [m] and Mach number of straight flight in which at least 14 of 16 draws of an aircraft
have a trim."""
LARGE_FT, LIGHT_LB = 70.0, 6000.0
"""Wing span from which, and empty weight up to which, an aircraft is drawn as large or light."""
PASCAL = 47.880259
"""In a pound per square foot."""
PROPERTIES: dict[str, str] = {
    "alpha": "aero/alpha-rad",
    "q": "velocities/q-rad_sec",
    "theta": "attitude/theta-rad",
    "Nz": "accelerations/Nz",
    "beta": "aero/beta-rad",
    "p": "velocities/p-rad_sec",
    "r": "velocities/r-rad_sec",
    "phi": "attitude/phi-rad",
    "Ny": "accelerations/Ny",
    "V": "velocities/vt-fps",
    "delta_e": "fcs/elevator-pos-rad",
    "delta_a": "fcs/right-aileron-pos-rad",
    "delta_r": "fcs/rudder-pos-rad",
}
"""Outputs of known channels; load factors at the centre of gravity, signs of JSBSim."""
COMMANDS: dict[str, tuple[str, float]] = {
    "delta_a": ("fcs/aileron-cmd-norm", -1.0),
    "delta_r": ("fcs/rudder-cmd-norm", 1.0),
    "delta_e": ("fcs/elevator-cmd-norm", 1.0),
}
"""Stick and pedals, and their signs where delta_a > 0 rolls left: in the order of commands."""


@dataclass(frozen=True)
class JsbsimPoint(PointRecipe):
    """A test point of an aircraft in trimmed, straight and level flight.

    altitude_m: above sea level.   speed_m_s: true airspeed.
    spread: of the factors of all aerodynamic functions that `parameters` does not name.
    channels: PROPERTIES if there are none.   inputs: added to the properties' values in trim.
    """

    altitude_m: Annotated[float | None, NOT_NEGATIVE] = None
    speed_m_s: Annotated[float | None, POSITIVE] = None
    spread: Annotated[float, Bounds(least=0)] = 0.1
    inputs: Mapping[str, Breakpoints] = field(default_factory=dict)


class Look(NamedTuple):
    """aircraft_class: its shape, for display."""

    aircraft_class: AircraftClass


@dataclass(frozen=True)
class JsbsimAircraft:
    """An aircraft of JSBSim, with its own flight controls; each aerodynamic function is uncertain.

    The scatter is assumed. Its files are those of the installed JSBSim.
    """

    model: str = "c172p"
    """model of JSBSim: brings the flight condition that suits it, unless that is given."""
    spread: Annotated[float, Bounds(least=0)] = 0.1
    """scatter: of a factor on each aerodynamic function, one sigma."""
    full_deg: Annotated[float, POSITIVE] = 25.0
    """full stick or pedal: the command that counts as full, to either side [deg]."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def description(self) -> str:
        name = self.model
        if is_installed() and name in aircraft_names():
            title = _read(name).get("name", name).replace(";", ",")
            name = name if title == name else f"{title} ({name})"
        return f"{name} of JSBSim, six degrees of freedom, with its own flight controls"

    @property
    def condition(self) -> Look:
        return Look(_look(self.model) if is_installed() else "light")

    @property
    def parameters(self) -> Parameters:
        """ValueError for an unknown aircraft, or without JSBSim."""
        names = tuple(functions_of(self.model))
        return Parameters(names, np.ones(len(names)), np.full(len(names), self.spread))

    def in_flight(self, point: "FlightPoint", dt: float, keys: Sequence[str]) -> "Jsbsim":
        """The aircraft trimmed at a point, with aileron, rudder and elevator [rad] as inputs.

        dt: [s] for which inputs are held.   keys: its outputs.
        """
        full, scales = radians(self.full_deg), {"V": FOOT, "qbar": PASCAL}
        outputs = [PROPERTIES.get(key, "aero/qbar-psf") for key in keys]
        scale = [scales.get(key, 1.0) for key in keys]
        for k, key in enumerate(keys):
            if key in COMMANDS and not writes(self.model, outputs[k]):
                outputs[k], sign = COMMANDS[key]
                scale[k] = sign * full
        inputs = [name for name, _ in COMMANDS.values()]
        return Jsbsim(
            self.model,
            point.altitude,
            point.airspeed,
            dt,
            functions_of(self.model),
            inputs,
            outputs,
            scale,
            [sign / full for _, sign in COMMANDS.values()],
            point.climb,
            point.bank,
            gusts=True,
        )


JSBSIM_AIRCRAFT = family("jsbsim_aircraft", JsbsimAircraft, {"jsbsim": JsbsimAircraft()})


def usual_condition(model: str) -> tuple[float, float]:
    """Altitude [m] and Mach number that suit an aircraft; those of a jet without a known trim."""
    return known_trim(model) or JET


def known_trim(model: str) -> tuple[float, float] | None:
    """That of USUALLY in which an aircraft has a trim; None if none is known."""
    return next((at for at, models in USUALLY.items() if model in models.split()), None)


def is_installed() -> bool:
    return find_spec("jsbsim") is not None


def functions_of(aircraft: str) -> list[str]:
    """Names of the aerodynamic functions. ValueError for an unknown aircraft, or without JSBSim."""
    if not is_installed():
        raise ValueError("an aircraft of JSBSim needs JSBSim: install forewarn[jsbsim]")
    known = aircraft_names()
    if aircraft not in known:
        raise ValueError(f"JSBSim has no aircraft {aircraft!r}: {instead_of(aircraft, known)}")
    return [str(each.get("name")) for each in _functions(_read(aircraft))]


@cache
def aircraft_names() -> tuple[str, ...]:
    """The aircraft with aerodynamic functions."""
    files = sorted(_root().glob("aircraft/*/*.xml"))
    names = [file.stem for file in files if file.stem == file.parent.name]
    return tuple(name for name in names if _functions(_read(name)))


def writes(aircraft: str, name: str) -> bool:
    """Whether the flight controls of an aircraft write a property."""
    files = (_root() / "aircraft" / aircraft).rglob("*.xml")
    return any(f"<output>{name}<" in "".join(file.read_text().split()) for file in files)


def _root() -> Path:
    from jsbsim import get_default_root_dir

    return Path(get_default_root_dir())


def _read(aircraft: str) -> ElementTree.Element:
    return ElementTree.parse(_root() / "aircraft" / aircraft / f"{aircraft}.xml").getroot()


def _functions(config: ElementTree.Element) -> list[ElementTree.Element]:
    return config.findall("aerodynamics/axis/function")


def _look(aircraft: str) -> AircraftClass:
    """By the wing span in feet and the empty weight in pounds of its file."""
    config = _read(aircraft) if aircraft in aircraft_names() else ElementTree.Element("")
    span, weight = (
        float(config.findtext(tag, "0")) for tag in ("metrics/wingspan", "mass_balance/emptywt")
    )
    if span > LARGE_FT:
        return "transport"
    return "light" if weight < LIGHT_LB else "fighter"


@dataclass(frozen=True)
class Jsbsim:
    """An aircraft, trimmed before each flight: straight, or in a turn without sideslip.

    altitude: above sea level [m].   speed: true airspeed [m/s].
    dt: [s] for which inputs are held.
    functions: those that theta multiplies.   inputs: properties that the inputs are added to.
    outputs: properties.   scale: (n_outputs,) their factors.
    gains: (n_inputs,) factors of the inputs; 1 if there are none.
    climb: flight path angle [rad].   bank: of a turn, about 0 for straight flight [rad].
    gusts: whether alpha and beta of the air [rad] come after the inputs.
    """

    aircraft: str
    altitude: float
    speed: float
    dt: float
    functions: Sequence[str]
    inputs: Sequence[str]
    outputs: Sequence[str]
    scale: Sequence[float]
    gains: Sequence[float] = ()
    climb: float = 0.0
    bank: float = 0.0
    gusts: bool = False

    def load(self) -> Fly:
        return _Aircraft(self).fly


class _Aircraft:
    """An aircraft in this process."""

    def __init__(self, model: Jsbsim) -> None:
        from jsbsim import FGFDMExec

        self._model, self._fdm = model, FGFDMExec(str(_root()))
        fdm: Any = self._fdm
        fdm.set_debug_level(0)
        fdm.set_aircraft_path(str(_edited(model.aircraft)))
        if not fdm.load_model(model.aircraft):
            raise ValueError("JSBSim cannot load it")
        known = [str(each).split()[0] for each in fdm.get_property_catalog()]
        for name in (*model.inputs, *model.outputs):
            if name not in known:
                raise ValueError(f"it has no property {name}: {instead_of(name, known)}")
        node = fdm.get_property_manager().get_node  # four times as fast as by name
        self._moved = [node(name) for name in model.inputs]
        self._read = [node(name).get_double_value for name in model.outputs]
        angles, ways = ("phi", "theta", "psi"), ("north", "east", "down")
        self._attitude = [node(f"attitude/{angle}-rad").get_double_value for angle in angles]
        self._gust = [node(f"atmosphere/gust-{way}-fps").set_double_value for way in ways]
        tanks = [name for name in known if name.endswith("/contents-lbs")]
        self._tanks = {name: fdm[name] for name in tanks}
        self._every = ceil(model.dt / LARGEST_STEP - 1e-9)
        fdm.set_dt(model.dt / self._every)
        fdm["simulation/models/FGGroundReactions/enabled"] = 0.0  # a fifth of the time, in free air
        # the first trim begins where none ended, so it is not repeated to the bit
        n_inputs = len(model.inputs) + 2 * model.gusts
        self.fly(np.ones(len(model.functions)), np.zeros((1, n_inputs)))

    def fly(self, theta: Array, inputs: Array) -> Array:
        """Outputs (n_samples, n_outputs) of factors theta. ImpossibleError without a trim."""
        model, run, steps, read = self._model, self._fdm.run, range(self._every), self._read
        self._trim(theta)
        y = array("d")
        moved = [node.set_double_value for node in self._moved]
        n_inputs = len(moved)
        rest = [node.get_double_value() for node in self._moved]
        positions = rest + inputs[:, :n_inputs] * (model.gains or 1.0)
        air = model.speed / FOOT * inputs[:, n_inputs:]
        for at, blown in zip(positions.tolist(), air.tolist(), strict=True):
            y.extend([value() for value in read])
            for move, position in zip(moved, at, strict=True):
                move(position)
            if model.gusts:
                self._blow(*blown)
            for _ in steps:
                run()
        return np.array(y).reshape(len(inputs), len(read)) * model.scale

    def _blow(self, down: float, side: float) -> None:
        """Air that moves along the body's z and y axes [ft/s]."""
        phi, theta, psi = (value() for value in self._attitude)
        level = side * cos(phi) - down * sin(phi)
        upright = side * sin(phi) + down * cos(phi)
        ahead = upright * sin(theta)
        north, east, below = self._gust
        north(ahead * cos(psi) - level * sin(psi))
        east(ahead * sin(psi) + level * cos(psi))
        below(upright * cos(theta))

    def _trim(self, theta: Array) -> None:
        from jsbsim import TrimFailureError

        model, fdm = self._model, self._fdm
        fdm.reset_to_initial_conditions(WITHOUT_INITIAL_RUN)
        for name, contents in self._tanks.items():
            fdm[name] = contents
        for name, factor in zip(model.functions, theta.tolist(), strict=True):
            fdm[FACTOR + name] = factor
        fdm["gear/gear-cmd-norm"] = fdm["gear/gear-pos-norm"] = 0.0
        fdm["ic/h-sl-ft"], fdm["ic/vt-fps"] = model.altitude / FOOT, model.speed / FOOT
        fdm["ic/beta-deg"], fdm["ic/gamma-deg"] = 0.0, degrees(model.climb)
        fdm["ic/phi-deg"] = degrees(model.bank)
        fdm.run_ic()
        mach = fdm["velocities/mach"]
        fdm["propulsion/set-running"] = -1
        try:
            fdm.do_trim(TURN_TRIM if model.bank else FULL_TRIM)
        except TrimFailureError:
            turn = f" in a turn with {degrees(model.bank):.3g} deg of bank" if model.bank else ""
            less = ", a smaller load factor" if model.bank else ""
            raise ImpossibleError(
                f"it has no trim at {model.speed:.4g} m/s (Mach {mach:.3g}) and "
                f"{model.altitude:g} m{turn}: give another Mach number or speed, another "
                f"altitude{less}, or smaller spreads"
            ) from None


def _edited(aircraft: str) -> Path:
    """A folder with the aircraft, of which each function has a factor, without connections."""
    places = Path(tempfile.mkdtemp(dir=Path.cwd()))
    place = Path(shutil.copytree(_root() / "aircraft" / aircraft, places / aircraft))
    config = _read(aircraft)
    for tag in ("input", "output", *(f"system[@file='{name}']" for name in ON_GROUND)):
        for each in config.findall(tag):  # inputs and outputs are sockets and files
            config.remove(each)
    (aerodynamics,) = config.findall("aerodynamics")
    for function in _functions(config):
        name = FACTOR + str(function.get("name"))
        (product,) = (part for part in function if part.tag != "description")
        if product.tag != "product":
            function.remove(product)
            (whole := ElementTree.SubElement(function, "product")).append(product)
            product = whole
        ElementTree.SubElement(product, "property").text = name
        declared = ElementTree.Element("property", value="1")
        declared.text = name
        aerodynamics.insert(0, declared)
    ElementTree.ElementTree(config).write(place / f"{aircraft}.xml")
    return places
