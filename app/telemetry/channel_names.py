"""Which column of a file is which channel, and in which unit: spelled `channel_unit`.

A name without a unit is taken only in the contract's own spelling (t, beta, p, r, Ny, delta_a,
delta_r, phi, theta, psi) and then means SI with N_y in g. Case does not matter. Every other column
is ignored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from textwrap import shorten

from app.telemetry.recording import ATTITUDE, TelemetryError
from core.channels import KEYS

STANDARD_GRAVITY = 9.80665
"""[m/s2] by definition (CGPM 1901)."""
DEG_PER_RAD = 180.0 / pi

# unit suffix -> how many of that unit make one SI unit (one g for the lateral acceleration)
TIME = {"s": 1.0, "ms": 1000.0}
ANGLE = {"rad": 1.0, "deg": DEG_PER_RAD}
RATE = {"radps": 1.0, "rad_s": 1.0, "degps": DEG_PER_RAD, "deg_s": DEG_PER_RAD}
ACCELERATION = {"g": 1.0, "mps2": STANDARD_GRAVITY, "m_s2": STANDARD_GRAVITY}

STEMS = {
    "t": (("t", "time"), TIME),
    "beta": (("beta",), ANGLE),
    "p": (("p",), RATE),
    "r": (("r",), RATE),
    "Ny": (("ny", "ay"), ACCELERATION),
    "delta_a": (("delta_a", "da"), ANGLE),
    "delta_r": (("delta_r", "dr"), ANGLE),
    "phi": (("phi",), ANGLE),
    "theta": (("theta",), ANGLE),
    "psi": (("psi",), ANGLE),
}
NEEDED = ("t", *KEYS)


@dataclass(frozen=True)
class Column:
    """A column that holds a channel; its values are divided by `per_si`. unit is "" if unnamed."""

    index: int
    name: str
    unit: str
    per_si: float


def _spellings(key: str) -> dict[str, tuple[str, float]]:
    """Lower-case column name -> (unit suffix, units per SI unit), for one channel."""
    stems, units = STEMS[key]
    named = {f"{stem}_{unit}": (unit, per_si) for stem in stems for unit, per_si in units.items()}
    return {key.lower(): ("", 1.0), **named}


SPELLINGS = {key: _spellings(key) for key in STEMS}


def find_columns(header: Sequence[str]) -> dict[str, Column]:
    """The column of each channel in a header line: all of NEEDED, and the attitude where present.

    Raises TelemetryError where a channel has two columns, and, naming all of them at once, where
    needed channels have none.
    """
    names = [name.strip() for name in header]
    columns = {}
    for key, spellings in SPELLINGS.items():
        found = [
            Column(index, name, *spellings[name.lower()])
            for index, name in enumerate(names)
            if name.lower() in spellings
        ]
        if len(found) > 1:
            raise TelemetryError(
                f"{key} has {len(found)} columns ({', '.join(c.name for c in found)}) where one "
                "is needed; remove or rename the others"
            )
        if found:
            columns[key] = found[0]
    missing = [key for key in NEEDED if key not in columns]
    if missing:
        raise TelemetryError(_missing(missing, names))
    return {key: columns[key] for key in (*NEEDED, *ATTITUDE) if key in columns}


def _missing(missing: list[str], names: list[str]) -> str:
    """The sentence that names every missing channel, what was found and what is accepted."""
    accepted = "; ".join(
        f"{key} as {', '.join([key, *list(SPELLINGS[key])[1:]])}" for key in missing
    )
    near = [
        f"{name} does not end in a known unit of {key}"
        for key in missing
        for name in names
        for stem in STEMS[key][0]
        if name.lower() == stem or name.lower().startswith(f"{stem}_")
    ]
    found = shorten(", ".join(names), 400, placeholder=" ...")
    because = f" ({shorten(', '.join(near), 400, placeholder=' ...')})" if near else ""
    return (
        f"no column for {', '.join(missing)}{because}; the columns found are {found}; "
        f"add them, or rename what holds them (upper or lower case): {accepted}"
    )
