"""Recordings of a flight for tests of the mapping, and folders of columns that hold them."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from app.telemetry.contents import Columns, ColumnWriter, open_columns
from app.telemetry.scaling import AS_RECORDED, Scaling
from core.channels import KEYS
from core.simulation.aircraft import PublishedAircraft
from core.simulation.published import MODELS, ModelName

Array = npt.NDArray[np.floating]
NOISE = {"beta": 3e-4, "p": 2e-3, "r": 6e-4, "Ny": 2e-3, "delta_a": 2e-4, "delta_r": 2e-4}


def columns_of(
    folder: Path,
    table: Mapping[str, npt.ArrayLike],
    *,
    units: Mapping[str, str] | None = None,
    times: Mapping[str, str] | None = None,
    scalings: Mapping[str, Scaling] | None = None,
) -> Columns:
    """Columns of a table; "group/name" puts a signal into a group.

    times: declared, by group.   scalings: declared, by signal.
    """
    folder.mkdir(exist_ok=True)
    writer = ColumnWriter(folder, 2**30)
    groups: dict[str, int] = {}
    for path, values in table.items():
        group, _, name = path.rpartition("//")
        if group not in groups:
            groups[group] = writer.add_group(group)
        declared = (times or {}).get(group) == name
        scaling = (scalings or {}).get(name, AS_RECORDED)
        unit = (units or {}).get(name, "")
        signal = writer.add_signal(groups[group], name, unit, time=declared, scaling=scaling)
        writer.append(signal, values)
    writer.finish("csv")
    return open_columns(folder)


@cache
def flight(
    model: ModelName = "attas_id_16kft", dt: float = 0.02, noisy: bool = True
) -> dict[str, Array]:
    """A rudder and an aileron doublet of a published aircraft: t and channels by key, in SI.

    With attitude and V, as a flight-test recorder has them; 24 s, without a damper.
    """
    plant = PublishedAircraft(model, n_states=4).uncertain_plant().nominal_plant()
    a, b, c, d = (matrix[0] for matrix in plant)
    t = dt * np.arange(round(24.0 / dt))
    u = np.zeros((len(t), 2))
    u[:, 1] = np.radians(4.0) * (_pulse(t, 3.0) - _pulse(t, 4.0))
    u[:, 0] = np.radians(2.5) * (_pulse(t, 12.0) - _pulse(t, 13.0))
    lag = np.exp(-dt / 0.1)
    for k in range(1, len(t)):
        u[k] = lag * u[k - 1] + (1.0 - lag) * u[k]
    n = len(a)
    step = expm(dt * np.block([[a, b], [np.zeros((2, n + 2))]]))
    x = np.zeros((len(t), n))
    for k in range(1, len(t)):
        x[k] = step[:n, :n] @ x[k - 1] + step[:n, n:] @ u[k - 1]
    y = x @ c.T + u @ d.T
    theta0 = MODELS[model].theta0
    channels = dict(zip(KEYS, y.T, strict=True))
    channels |= {
        "phi": x[:, 3],
        "theta": np.full(len(t), theta0),
        "psi": np.cumsum(y[:, 2]) * dt / np.cos(theta0),
        "V": np.full(len(t), MODELS[model].speed),
    }
    if noisy:
        rng = np.random.default_rng(3)
        for key, sigma in NOISE.items():
            channels[key] = channels[key] + sigma * rng.standard_normal(len(t))
        channels["theta"] = theta0 + 0.01 * np.sin(0.7 * t)
        channels["V"] = channels["V"] + 0.5 * np.sin(0.3 * t)
    return {"t": t, **channels}


def quaternion(phi: Array, theta: Array, psi: Array) -> dict[str, Array]:
    """The attitude as a quaternion, scalar first."""
    (cp, sp), (ct, st), (cs, ss) = ((np.cos(x / 2), np.sin(x / 2)) for x in (phi, theta, psi))
    return {
        "q0": cp * ct * cs + sp * st * ss,
        "q1": sp * ct * cs - cp * st * ss,
        "q2": cp * st * cs + sp * ct * ss,
        "q3": cp * ct * ss - sp * st * cs,
    }


def _pulse(t: Array, start: float) -> Array:
    return ((t >= start) & (t < start + 1.0)).astype(float)
