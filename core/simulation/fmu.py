"""Functional mock-up units: co-simulation by FMI 2 and 3, with FMPy (extra `fmu`)."""

import tempfile
from collections.abc import Callable, Sequence
from ctypes import addressof, c_bool, c_double, c_int, c_size_t, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from core import types
from core.simulation.flight_process import Fly

WARNING, DISCARD = 1, 2
"""Status of a call. Up to a warning it worked; a discarded step ends the flight."""

References = Sequence[int]
"""FMI's numbers of variables, its value references."""


@dataclass(frozen=True)
class Fmu:
    """A model for co-simulation.

    path: of the .fmu file, absolute.   version: of FMI, 2 or 3.
    dt: communication step [s], for which inputs are held.
    scale, offset: (n_outputs,) an output is scale * value + offset.
    """

    path: str
    version: int
    dt: float
    parameters: References
    inputs: References
    outputs: References
    scale: Sequence[float]
    offset: Sequence[float]

    def load(self) -> Fly:
        slave = _Slave(self)

        def fly(theta: types.Array, inputs: types.Array) -> types.Array:
            return slave.fly(theta, inputs) * self.scale + self.offset

        return fly


class _Slave:
    """An instance of the model in this process; each flight begins with a reset."""

    def __init__(self, fmu: Fmu) -> None:
        from fmpy import extract, read_model_description

        self._fmu, self._messages, self._is_new = fmu, list[str](), True
        self._kept: list[Any] = []  # what the model has addresses of
        folder = str(extract(fmu.path, tempfile.mkdtemp(dir=Path.cwd())))
        description: Any = read_model_description(folder, validate=False)
        named = {
            "guid": description.guid,
            "unzipDirectory": folder,
            "modelIdentifier": description.coSimulation.modelIdentifier,
        }
        self._slave = self._instance_of_3(named) if fmu.version == 3 else self._instance_of_2(named)
        self._set_parameters = self._transfer("Set", fmu.parameters)
        self._set_inputs = self._transfer("Set", fmu.inputs)
        self._get_outputs = self._transfer("Get", fmu.outputs)
        self._step = self._stepping_3() if fmu.version == 3 else self._stepping_2()

    def _instance_of_2(self, named: dict[str, str]) -> Any:
        from ctypes import byref

        from fmpy import calloc, fmi2, free
        from fmpy.logging import addLoggerProxy

        self._kept.append(callbacks := fmi2.fmi2CallbackFunctions())
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._on_message)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(callbacks))
        slave = fmi2.FMU2Slave(**named)
        slave.instantiate(callbacks=callbacks)
        return slave

    def _instance_of_3(self, named: dict[str, str]) -> Any:
        from fmpy.fmi3 import FMU3Slave

        slave = FMU3Slave(**named)
        slave.instantiate(logMessage=self._on_message)
        return slave

    def _on_message(self, *arguments: Any) -> None:
        self._messages.append(arguments[-1].decode(errors="replace"))

    def fly(self, theta: types.Array, inputs: types.Array) -> types.Array:
        """Values (n_samples, n_outputs), NaN after the model ended the flight."""
        if not self._is_new:
            self._slave.reset()
        self._is_new = False
        theta, inputs = np.ascontiguousarray(theta), np.ascontiguousarray(inputs)
        y = np.full((len(inputs), len(self._fmu.outputs)), np.nan)
        self._set_parameters(theta.ctypes.data)
        if self._fmu.version == 2:
            self._slave.setupExperiment(startTime=0.0)
        self._slave.enterInitializationMode()
        self._set_inputs(inputs.ctypes.data)
        self._slave.exitInitializationMode()
        self._get_outputs(y.ctypes.data)
        changes = np.any(np.diff(inputs, axis=0) != 0.0, axis=1).tolist()
        controls, row = inputs.ctypes.data, y.ctypes.data
        for k, changed in enumerate(changes):
            row += y.strides[0]
            if not self._step(k * self._fmu.dt):
                break
            controls += inputs.strides[0]
            if changed:
                self._set_inputs(controls)
            self._get_outputs(row)
        return y

    def _transfer(self, verb: str, references: References) -> Callable[[int], None]:
        """A function that sets variables from an address, or gets them to it."""
        kind = "3%sFloat64" if self._fmu.version == 3 else "2%sReal"
        name, n = f"fmi{kind % verb}", len(references)
        call = self._slave.dll[name]
        call.restype, call.argtypes = c_int, [c_void_p, c_void_p, c_size_t, c_void_p]
        if self._fmu.version == 3:
            call.argtypes = [*call.argtypes, c_size_t]
        self._kept.append(these := np.array(references, np.uint32))
        fixed, sizes = (self._slave.component, these.ctypes.data, n), call.argtypes[4:] and (n,)

        def transfer(address: int) -> None:
            status = call(*fixed, address, *sizes) if n else 0
            if status > WARNING:
                self._failed(name, status)

        return transfer

    def _stepping_2(self) -> Callable[[float], bool]:
        """A function that makes the step from t [s]; whether the flight goes on."""
        call, component, dt = self._slave.dll["fmi2DoStep"], self._slave.component, self._fmu.dt
        call.restype, call.argtypes = c_int, [c_void_p, c_double, c_double, c_int]

        def step(t: float) -> bool:
            status = call(component, t, dt, 1)
            if status > DISCARD:
                self._failed("fmi2DoStep", status)
            return status <= WARNING

        return step

    def _stepping_3(self) -> Callable[[float], bool]:
        call, component, dt = self._slave.dll["fmi3DoStep"], self._slave.component, self._fmu.dt
        call.restype = c_int
        call.argtypes = [c_void_p, c_double, c_double, c_bool, *[c_void_p] * 4]
        answers = _, ends, _, _ = c_bool(), c_bool(), c_bool(), c_double()
        addresses = [addressof(each) for each in answers]
        self._kept.append(answers)

        def step(t: float) -> bool:
            status = call(component, t, dt, True, *addresses)
            if status > DISCARD:
                self._failed("fmi3DoStep", status)
            return status <= WARNING and not ends.value

        return step

    def _failed(self, name: str, status: int) -> NoReturn:
        message = f": {self._messages[-1]}" if self._messages else ""
        raise ValueError(f"{name} returned status {status}{message}")
