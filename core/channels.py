"""Telemetry dictionaries: the channels of a sample y, their order, units and roles."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import degrees, pi
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from core.bounds import Bounds, check_bounds
from core.kernels import N_CHANNELS
from core.recipe import instead_of

if TYPE_CHECKING:
    from core.formulas import Formula

Role = Literal["output", "control", "condition"]
Reference = Literal["trim", "absolute"]
MOST_CHANNELS = 32


@dataclass(frozen=True)
class Channel:
    """One measured or computed quantity, with its unit, label and display.

    unit: SI, or g; for computing, storing and sending.
    display_unit: for people; display_factor converts from `unit`.
    display_decimals: significant decimals in display_unit.
    role: an output responds to the controls; a condition, such as airspeed, only describes the
    flight.   reference: values are deviations from trim, or absolute.
    largest: magnitude that no aircraft reaches, in `unit`; None if unknown.
    group: strips of one group are shown together.
    formula: of channels before this one, which a source then does not send (`core.formulas`).
    """

    key: str
    symbol: str
    unit: str
    label: str
    display_unit: str
    display_factor: Annotated[float, Bounds(above=0)]
    display_decimals: Annotated[int, Bounds(least=0)]
    role: Role = "output"
    reference: Reference = "trim"
    largest: Annotated[float | None, Bounds(above=0)] = None
    group: str = ""
    formula: str = ""

    @property
    def named(self) -> str:
        """`normal acceleration (Nz)`: for messages."""
        return f"{self.label} ({self.key})" if self.label != self.key else self.key

    def read(self, value: float, digits: int = 3) -> str:
        """`4.98 deg`: a value in its display unit, to this many significant digits."""
        return f"{significant(value * self.display_factor, digits)} {self.display_unit}".rstrip()


READABLE = 1e9
"""From this magnitude on, numbers are written with a power of ten."""


def significant(value: float, digits: int = 3) -> str:
    """A number to this many significant digits, but never fewer than before the point."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < READABLE else text.replace("e+", "e")


DISPLAY: dict[str, tuple[str, float, int]] = {
    "rad": ("deg", degrees(1.0), 2),
    "rad/s": ("deg/s", degrees(1.0), 1),
    "g": ("g", 1.0, 3),
    "1": ("", 1.0, 3),
}
"""Display unit, factor and decimals of a unit; other units are displayed unchanged."""

BEYOND_FLIGHT: dict[str, float] = {"rad": pi, "rad/s": 4.0 * pi}
"""Magnitudes that no aircraft reaches, by unit: a half turn, two turns a second."""


def channel(
    key: str,
    symbol: str,
    unit: str,
    label: str,
    role: Role = "output",
    reference: Reference = "trim",
    group: str = "",
) -> Channel:
    """A channel with the display of its unit."""
    display, largest = DISPLAY.get(unit, (unit, 1.0, 2)), BEYOND_FLIGHT.get(unit)
    return Channel(key, symbol, unit, label, *display, role, reference, largest, group)


@dataclass(frozen=True)
class Dictionary:
    """The channels of a dataset and of its monitor, in order: 1 to MOST_CHANNELS."""

    name: str
    channels: tuple[Channel, ...]

    def __post_init__(self) -> None:
        keys = [known.key for known in self.channels]
        if not 1 <= len(keys) <= MOST_CHANNELS:
            raise ValueError(f"{len(keys)} channels were given: give 1 to {MOST_CHANNELS}")
        if twice := [key for key in keys if keys.count(key) > 1]:
            raise ValueError(f"two channels have the key {twice[0]!r}: give each its own")
        if not all(keys):
            raise ValueError("a channel has no key: give each one")
        if not self.measured:
            raise ValueError("all channels have formulas: give those that a source sends")
        for known in self.channels:
            if known.formula and known.role != "output":
                raise ValueError(
                    f"channel {known.key} has a formula and the role {known.role!r}: a computed "
                    "channel is an output"
                )
        _ = self.formulas  # refuses those that cannot be read

    def __len__(self) -> int:
        return len(self.channels)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        return tuple(known.key for known in self.channels)

    def index(self, key: str) -> int:
        """Position of a channel. ValueError names the channels if it is unknown."""
        if key not in self.keys:
            raise ValueError(f"channel {key!r} is unknown: {instead_of(key, self.keys)}")
        return self.keys.index(key)

    def of_role(self, role: Role) -> tuple[int, ...]:
        """Positions of the channels with this role."""
        return tuple(k for k, known in enumerate(self.channels) if known.role == role)

    @cached_property
    def controls(self) -> tuple[str, ...]:
        """Keys of the controls."""
        return tuple(self.keys[c] for c in self.of_role("control"))

    def plus(self, *more: Channel) -> Self:
        """This dictionary with more channels after its own. ValueError."""
        if not more:
            return self
        name = "own" if self.name in DICTIONARIES else self.name
        return replace(self, name=name, channels=(*self.channels, *more))

    @cached_property
    def measured(self) -> tuple[str, ...]:
        """Keys of the channels that a source sends."""
        return tuple(known.key for known in self.channels if not known.formula)

    @cached_property
    def formulas(self) -> "tuple[tuple[int, Formula], ...]":
        """Positions and formulas of the computed channels."""
        return tuple((c, self._parsed(c)) for c, known in enumerate(self.channels) if known.formula)

    def _parsed(self, c: int) -> "Formula":
        from core.formulas import FormulaError, parse  # slow to import, as numpy is

        try:
            return parse(self.channels[c].formula, self.keys[:c])
        except FormulaError as error:
            raise ValueError(f"channel {self.keys[c]}: {error}") from None

    @property
    def stored(self) -> dict[str, Any] | None:
        """As it is stored: None for the lateral channels, which older files do not name."""
        return None if self == LATERAL else self.to_plain()

    @classmethod
    def from_stored(cls, stored: Mapping[str, Any] | None) -> "Dictionary":
        """Reverse of `stored`.   ValueError."""
        return LATERAL if stored is None else cls.from_plain(stored)

    @cached_property
    def absolute(self) -> tuple[int, ...]:
        """Positions of the channels that do not count from trim."""
        return tuple(k for k, known in enumerate(self.channels) if known.reference == "absolute")

    @cached_property
    def by_key(self) -> dict[str, Channel]:
        return {known.key: known for known in self.channels}

    def sources(self, keys: Collection[str]) -> tuple[str, ...]:
        """Keys of the measured channels among these, and of those that the computed ones read."""
        needed = {self.index(key) for key in keys}
        for c, formula in reversed(self.formulas):
            if c in needed:
                needed |= formula.inputs
        return tuple(key for key in self.measured if self.index(key) in needed)

    def to_plain(self) -> dict[str, Any]:
        return {"name": self.name, "channels": [_plain(known) for known in self.channels]}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Self:
        """Rebuild it. ValueError if a channel lacks its key or unit, or has an unknown field."""
        return cls(str(plain["name"]), tuple(map(_channel_of, plain["channels"])))


def _plain(known: Channel) -> dict[str, Any]:
    """Without an empty formula, so that the digests of older dictionaries stay."""
    plain = asdict(known)
    if not known.formula:
        del plain["formula"]
    return plain


def _channel_of(plain: Mapping[str, Any]) -> Channel:
    if missing := [name for name in ("key", "unit") if not isinstance(plain.get(name), str)]:
        raise ValueError(f"channel {dict(plain)!r} has no {missing[0]}: give key and unit")
    if not isinstance(plain.get("formula", ""), str):
        raise ValueError(f"channel {plain['key']!r} has a formula that is not text: give text")
    key, unit = plain["key"], plain["unit"]
    reference = "absolute" if plain.get("formula") else "trim"
    usual: dict[str, Any] = asdict(channel(key, key, unit, key, reference=reference))
    usual["largest"] = None
    if unknown := [name for name in plain if name not in usual]:
        raise ValueError(f"channel {key!r} has {unknown[0]!r}: {instead_of(unknown[0], usual)}")
    given = Channel(**usual | dict(plain))
    try:
        check_bounds(given, f"channel {key!r}: ")
    except TypeError as error:
        raise ValueError(f"channel {key!r} has text instead of a number: {error}") from error
    for name in ("symbol", "label", "display_unit", "group"):
        if not isinstance(getattr(given, name), str):
            raise ValueError(f"the {name} of channel {key!r} is not text: give text")
    return given


LATERAL = Dictionary(
    "lateral",
    (
        channel("beta", "β", "rad", "sideslip", group="angles"),
        channel("p", "p", "rad/s", "roll rate", group="rates"),
        channel("r", "r", "rad/s", "yaw rate", group="rates"),
        channel("Ny", "N_y", "g", "lateral acceleration", group="acceleration"),
        channel("delta_a", "δ_a", "rad", "aileron", "control", group="surfaces"),
        channel("delta_r", "δ_r", "rad", "rudder", "control", group="surfaces"),
    ),
)
"""The six channels of the paper."""
LONGITUDINAL = Dictionary(
    "longitudinal",
    (
        channel("alpha", "α", "rad", "angle of attack", "output", "absolute", "angles"),
        channel("q", "q", "rad/s", "pitch rate", group="rates"),
        channel("theta", "θ", "rad", "pitch angle", "output", "absolute", "angles"),
        channel("Nz", "N_z", "g", "normal acceleration", "output", "absolute", "acceleration"),
        channel("V", "V", "m/s", "true airspeed", "condition", "absolute", "speed"),
        channel("delta_e", "δ_e", "rad", "elevator", "control", "absolute", "surfaces"),
    ),
)
SIX_DOF = Dictionary(
    "six_dof",
    (
        *LONGITUDINAL.channels[:4],
        channel("beta", "β", "rad", "sideslip", "output", "absolute", "angles"),
        channel("p", "p", "rad/s", "roll rate", group="rates"),
        channel("r", "r", "rad/s", "yaw rate", group="rates"),
        channel("phi", "φ", "rad", "bank angle", "output", "absolute", "angles"),
        channel("Ny", "N_y", "g", "lateral acceleration", group="acceleration"),
        LONGITUDINAL.channels[4],
        LONGITUDINAL.channels[5],
        channel("delta_a", "δ_a", "rad", "aileron", "control", "absolute", "surfaces"),
        channel("delta_r", "δ_r", "rad", "rudder", "control", "absolute", "surfaces"),
    ),
)
DICTIONARIES: dict[str, Dictionary] = {
    known.name: known for known in (LATERAL, LONGITUDINAL, SIX_DOF)
}


def known_channels() -> dict[str, Channel]:
    """The channels of all dictionaries by key; SIX_DOF's, where they differ."""
    return {each.key: each for known in DICTIONARIES.values() for each in known.channels}


CHANNELS: tuple[Channel, ...] = LATERAL.channels
BY_KEY: dict[str, Channel] = {known.key: known for known in CHANNELS}
KEYS: tuple[str, ...] = LATERAL.keys
if len(CHANNELS) != N_CHANNELS:
    raise AssertionError(f"{len(CHANNELS)} channels: the kernels compute with {N_CHANNELS}")
