"""Aircraft of JSBSim (extra `jsbsim`), with every aerodynamic function made uncertain.

The aircraft's file is edited in the folder of a process; JSBSim's own files stay as they are.
"""

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import ceil
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np

from core.bounds import NOT_NEGATIVE, Bounds
from core.recipe import instead_of
from core.simulation.flight_process import Fly
from core.simulation.point import POSITIVE, Breakpoints, PointRecipe
from core.simulation.python_simulator import ImpossibleError
from core.types import Array

LARGEST_STEP = 0.005
"""Step of integration [s]; with longer ones the peaks depend on it."""
FULL_TRIM, WITHOUT_INITIAL_RUN = 1, 2
FACTOR = "factor/"
"""Before the name of a function: the property that multiplies it."""
FOOT = 0.3048
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


def functions_of(aircraft: str) -> list[str]:
    """Names of the aerodynamic functions. ValueError for an unknown aircraft."""
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


@dataclass(frozen=True)
class Jsbsim:
    """An aircraft, trimmed straight and level before each flight.

    altitude: above sea level [m].   speed: true airspeed [m/s].
    dt: [s] for which inputs are held.
    functions: those that theta multiplies.   inputs: properties that the inputs are added to.
    outputs: properties.   scale: (n_outputs,) their factors.
    """

    aircraft: str
    altitude: float
    speed: float
    dt: float
    functions: Sequence[str]
    inputs: Sequence[str]
    outputs: Sequence[str]
    scale: Sequence[float]

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
        tanks = [name for name in known if name.endswith("/contents-lbs")]
        self._tanks = {name: fdm[name] for name in tanks}
        self._every = ceil(model.dt / LARGEST_STEP - 1e-9)
        fdm.set_dt(model.dt / self._every)
        fdm["simulation/models/FGGroundReactions/enabled"] = 0.0  # a fifth of the time, in free air
        # the first trim begins where none ended, so it is not repeated to the bit
        self.fly(np.ones(len(model.functions)), np.zeros((1, len(model.inputs))))

    def fly(self, theta: Array, inputs: Array) -> Array:
        """Outputs (n_samples, n_outputs) of factors theta. ImpossibleError without a trim."""
        model, fdm, y = self._model, self._fdm, np.empty((len(inputs), len(self._model.outputs)))
        self._trim(theta)
        rest = [fdm[name] for name in model.inputs]
        for row, commands in zip(y, inputs.tolist(), strict=True):
            row[:] = [fdm[name] for name in model.outputs]
            for name, at, command in zip(model.inputs, rest, commands, strict=True):
                fdm[name] = at + command
            for _ in range(self._every):
                fdm.run()
        return y * model.scale

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
        fdm["ic/gamma-deg"] = fdm["ic/beta-deg"] = 0.0
        fdm.run_ic()
        fdm["propulsion/set-running"] = -1
        try:
            fdm.do_trim(FULL_TRIM)
        except TrimFailureError:
            raise ImpossibleError(
                f"it has no trim at {model.speed:g} m/s and {model.altitude:g} m: give another "
                "speed, or smaller spreads"
            ) from None


def _edited(aircraft: str) -> Path:
    """A folder with the aircraft, of which each function has a factor, without connections."""
    places = Path(tempfile.mkdtemp(dir=Path.cwd()))
    place = Path(shutil.copytree(_root() / "aircraft" / aircraft, places / aircraft))
    config = _read(aircraft)
    for tag in ("input", "output"):  # sockets and files
        for each in config.findall(tag):
            config.remove(each)
    (aerodynamics,) = config.findall("aerodynamics")
    for function in _functions(config):
        name = FACTOR + str(function.get("name"))
        product = ElementTree.Element("product")
        ElementTree.SubElement(product, "property").text = name
        for part in [each for each in function if each.tag != "description"]:
            function.remove(part)
            product.append(part)
        function.append(product)
        declared = ElementTree.Element("property", value="1")
        declared.text = name
        aerodynamics.insert(0, declared)
    ElementTree.ElementTree(config).write(place / f"{aircraft}.xml")
    return places
