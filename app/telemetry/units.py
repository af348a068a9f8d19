"""Parse units as telemetry spells them and convert them to ours.

Angles are a dimension (a sideslip in percent is a mistake, and so is a roll rate in hertz), g is
gravity and never gram, and case does not matter.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from functools import cache
from math import pi

from app.telemetry.recording import TelemetryError
from core.recipe import instead_of
from core.types import Array

STANDARD_GRAVITY = 9.80665
"""[m/s2] by definition (CGPM 1901)."""

# our spelling: (size in other units, other spellings)
BASIC: dict[str, tuple[str, str]] = {
    "rad": ("[angle]", "radian radians rads"),
    "deg": (f"{pi / 180!r} rad", "degree degrees degs ° grad"),
    "cdeg": (f"{pi / 18000!r} rad", "centidegree centidegrees centideg centidegs cdegs"),
    "mrad": ("0.001 rad", "milliradian milliradians"),
    "rev": (f"{2 * pi!r} rad", "revolution revolutions turn turns"),
    "s": ("[time]", "sec secs second seconds sek sekunden"),
    "ms": ("0.001 s", "msec msecs millis millisecond milliseconds"),
    "us": ("0.000001 s", "usec usecs micros microsecond microseconds"),
    "ns": ("0.000000001 s", "nsec nsecs nanos nanosecond nanoseconds"),
    "min": ("60 s", "mins minute minutes"),
    "h": ("3600 s", "hr hrs hour hours"),
    "day": ("86400 s", "d days"),
    "m": ("[length]", "meter meters metre metres mtr"),
    "km": ("1000 m", "kilometer kilometers kilometre kilometres"),
    "cm": ("0.01 m", "centimeter centimetre"),
    "mm": ("0.001 m", "millimeter millimetre"),
    "ft": ("0.3048 m", "foot feet '"),
    "kft": ("1000 ft", ""),
    "FL": ("100 ft", "flight_level flightlevel"),
    "NM": ("1852 m", "nmi nauticalmile nauticalmiles"),
    "mi": ("1609.344 m", "mile miles"),
    "in": ("0.0254 m", "inch inches"),
    "g": (f"{STANDARD_GRAVITY} m/s^2", "gs g's gn g0 g_0 gee gees"),
    "mg": ("0.001 g", "milli-g millig"),
    "kN": ("1000 N", "kilonewton kilonewtons"),  # kn is a knot, see `_plain`
    "kt": ("1852 m/h", "kts kn knot knots ktas kias kcas keas"),
    "Hz": ("1 s^-1", "hertz"),
    "Pa": ("[pressure]", "pascal"),
    "hPa": ("100 Pa", "mbar mb hectopascal"),
    "kPa": ("1000 Pa", ""),
    "bar": ("100000 Pa", ""),
    "psi": ("6894.757 Pa", "psia psig"),
    "inHg": ("3386.389 Pa", ""),
    "psf": ("47.88026 Pa", ""),
    "K": ("[temperature]", "kelvin degk deg_k"),
    "degC": ("[celsius]", "celsius °c deg_c degc oc"),  # its zero is not that of K
    "degF": ("[fahrenheit]", "fahrenheit °f deg_f degf"),
    "N": ("[force]", "newton newtons"),
    "lbf": ("4.448222 N", "lb lbs pound pounds"),
    "kg": ("[mass]", "kilogram kilograms"),
    "V": ("[voltage]", "volt volts"),
    "mV": ("0.001 V", "millivolt millivolts"),
    "A": ("[current]", "amp amps ampere amperes"),
    "%": ("[share]", "percent pct prozent"),
    "counts": ("[count]", "count bit bits lsb cnts"),
}
# one word, or another spelling that `_parsed` cannot read
ONE_WORD: dict[str, str] = {
    "0.01deg": "cdeg", "0.01°": "cdeg", "deg/100": "cdeg", "deg*100": "cdeg",
    "degps": "deg/s", "degpersec": "deg/s", "degpersecond": "deg/s", "degs/s": "deg/s",
    "dps": "deg/s", "dps2": "deg/s^2", "degps2": "deg/s^2",
    "radps": "rad/s", "radpersec": "rad/s", "radpersecond": "rad/s", "r/s": "rad/s",
    "radps2": "rad/s^2", "rpm": "rev/min",
    "mps": "m/s", "mpersec": "m/s", "fps": "ft/s", "ftps": "ft/s", "fpm": "ft/min",
    "kmh": "km/h", "kph": "km/h", "kmph": "km/h", "mph": "mi/h",
    "mps2": "m/s^2", "mpss": "m/s^2", "mss": "m/s^2", "m/s/s": "m/s^2", "mpsec2": "m/s^2",
    "ms2": "m/s^2", "ms-2": "m/s^2", "ms^-2": "m/s^2", "ms-1": "m/s", "ms^-1": "m/s",
    "fps2": "ft/s^2", "ftps2": "ft/s^2", "fpss": "ft/s^2", "ft/s/s": "ft/s^2",
}  # fmt: skip
NOT_GIVEN = frozenset(
    ("", "-", "--", "none", "n/a", "na", "nd", "nan", "unitless", "unit", "no unit", "?", "eu", "1")
)
"""Spellings of a missing unit."""
PLAIN = "1"
"""The unit of dimensionless quantities."""
CHOICES: dict[str, tuple[str, ...]] = {
    "rad": ("rad", "deg", "mrad", "cdeg"),
    "rad/s": ("rad/s", "deg/s"),
    "g": ("g", "m/s^2", "ft/s^2", "mg"),
    "m/s": ("m/s", "kt", "ft/s", "km/h"),
    "m": ("m", "ft", "FL", "km"),
    "s": ("s", "ms", "us", "ns", "min", "h", "day"),
    "rad/s^2": ("rad/s^2", "deg/s^2"),
    "Pa": ("Pa", "hPa", "kPa", "bar", "psf", "psi", "inHg"),
    "N": ("N", "lbf"),
    "N*m": ("N*m", "lbf*ft"),
    "kg": ("kg",),
    "K": ("K",),
}
"""By unit of the target, which is the first."""

_NAMES = {
    spelling: unit
    for unit, (_, others) in BASIC.items()
    for spelling in (unit.lower(), *others.split())
}
_TIMES = {"s", "ms", "min", "h"}
_PART = re.compile(r"([*/_ ]*)([a-z%'°º]+)(?:(?:\^|\*\*)?([-+]?\d))?")


def factor(unit: str, target: str) -> float:
    """One `unit` in units of the target.

    Raises TelemetryError for an unknown unit and for a unit of another kind.
    """
    return _factor(unit.strip(), target)


def spelled(unit: str) -> str:
    """A unit in our spelling, "deg/s" for Degrees/sec; "" if the text is not a unit."""
    return "".join(
        f"{separator}{name}{f'^{power}' if power > 1 else ''}"
        for separator, name, power in _ordered(unit)
    )


def choices(target: str) -> list[str]:
    """The units in which a quantity in `target` is commonly recorded, target first."""
    return list(CHOICES.get(target, (target,)))


def fits(unit: str, target: str) -> bool:
    """Whether a text is a unit of the target's kind."""
    try:
        factor(unit, target)
    except TelemetryError:
        return False
    return True


def si_unit(unit: str) -> str:
    """The unit in which a quantity recorded in `unit` is computed; TelemetryError for none."""
    for target in (PLAIN, *CHOICES):
        if fits(unit, target):
            return target
    if known := spelled(unit):
        return known
    raise TelemetryError(f"{unit!r} is not a known unit: {instead_of(unit, BASIC)}")


def convert(values: Array, unit: str, target: str) -> Array:
    """Values converted to the target's unit; the same array if the units are equal."""
    per_unit = factor(unit, target)
    if per_unit == 1.0:
        return values
    divisor = round(1.0 / per_unit)
    if divisor > 1 and abs(divisor * per_unit - 1.0) < 1e-12:
        return values / divisor  # 50 ms is 0.05 s, but 50 * 0.001 is not exactly
    return values * per_unit


@cache
def _factor(unit: str, target: str) -> float:
    if target.lower() in NOT_GIVEN and unit.lower() in NOT_GIVEN:
        return 1.0
    text = "m/s" if target == "m/s" and unit.lower() in ("ms", "m_s") else unit
    parts = _parsed(text)
    if not parts:
        raise TelemetryError(
            f"{unit!r} is not a known unit: give one of {', '.join(choices(target))}"
        )
    ours = _parsed(target)
    if parts == ours:
        return 1.0
    (size, dimensions), (target_size, needed) = _measure(parts), _measure(ours)
    if dimensions != needed:
        raise TelemetryError(
            f"{unit!r} is not a unit of this quantity, which is in {target}: give one of "
            f"{', '.join(choices(target))}"
        )
    return size / target_size


def _measure(parts: dict[str, int], size: float = 1.0) -> tuple[float, dict[str, int]]:
    """Size of a product of powers of units, and the powers of its dimensions."""
    powers = Counter[str]()
    for unit, power in parts.items():
        of_unit, dimensions = _measure_of(unit)
        size = size * of_unit**power if power > 0 else size / of_unit**-power
        for dimension, times in dimensions.items():
            powers[dimension] += power * times
    return size, {dimension: power for dimension, power in powers.items() if power}


@cache
def _measure_of(unit: str) -> tuple[float, dict[str, int]]:
    definition = BASIC[unit][0]
    if definition.startswith("["):
        return 1.0, {definition: 1}
    number, units = definition.split()
    return _measure(_parsed(units), float(number))


def _ordered(text: str) -> list[tuple[str, str, int]]:
    """Parts as (separator, unit, power above zero), numerator first."""
    parts = _parsed(text)
    above = [(unit, power) for unit, power in parts.items() if power > 0]
    below = [(unit, -power) for unit, power in parts.items() if power < 0]
    if not above and below:
        return []
    head = [("*" if k else "", *part) for k, part in enumerate(above)]
    return [*head, *(("/", *part) for part in below)]


@cache
def _parsed(text: str) -> dict[str, int]:
    """Unit -> power; empty if the text is not a unit."""
    plain = _plain(text)
    if plain in NOT_GIVEN:
        return {}
    plain = ONE_WORD.get(plain.replace(" ", ""), plain)
    if plain in _NAMES:
        return {_NAMES[plain]: 1}
    parts: dict[str, int] = {}
    end, below = 0, False
    for match in _PART.finditer(plain):
        separator, name, digits = match.groups()
        if match.start() != end or name not in _NAMES or bool(end) != bool(separator):
            return {}
        end = match.end()
        unit, power = _NAMES[name], int(digits or 1)
        divides = "/" in separator or below
        # deg_s and m_s2 omit the slash
        loose = bool(parts) and power > 0 and "*" not in separator and unit in _TIMES
        below = below or "/" in separator
        parts[unit] = parts.get(unit, 0) + (-power if divides or loose else power)
    return parts if end and end == len(plain) else {}


def _plain(text: str) -> str:
    """Lower case with uniform signs: "°/s²" -> "°/s2", "m·s⁻²" -> "m*s-2"."""
    text = text.strip().replace("º", "°").replace("µ", "u").replace("μ", "u")
    text = unicodedata.normalize("NFKC", text).replace("−", "-").replace("’", "'")
    text = re.sub(r"\bkN\b", "kilonewton", text)
    text = re.sub(r"^[\[({<]\s*(.*?)\s*[\])}>]$", r"\1", text).lower()
    text = re.sub(r"\s+since\s.*$", "", text)  # NetCDF: "seconds since 2019-03-12"
    text = re.sub(r"\s+per\s+|_per_", "/", text)
    text = re.sub(r"(?<=[a-z])[·⋅.](?=[a-z])", "*", text).rstrip(".")
    return re.sub(r"\s*([*/^])\s*", r"\1", text)


MARKED_UNIT = re.compile(r"\[([^\[\]]*)\]|\{([^{}]*)\}|<([^<>]*)>|\(([^()]*)\)")
UNIT_AT_END = re.compile(rf"\S\s*(?:{MARKED_UNIT.pattern})$")
UNIT_WORDS = (
    "sr um µm µs t ts mach khz mhz lbm slug dan ftlb mpa mmhg atm c f °k kv ma ka µa w mw kw j kj "
    "ohm gauss nt µt bool boolean raw enum flag per sq rads hh ss hms yyyy dd utc"
)
"""Words of units that are never converted, or of formats of a time."""
SURE_UNIT = re.compile(
    r"s|secs?|seconds?|sek|ms|degs?|degrees?|grad|rad|[°º%]|kts?|ft|hz|[°º]c|degc|[hk]pa|.+[/*·^].+"
)


def unit_in(name: str) -> str:
    """Unit in brackets at the end of a name, "" for none.

    Parentheses count only if the text reads like a unit: "p (deg/s)", but not "beta (filtered)".
    """
    match = UNIT_AT_END.search(name)
    if not match:
        return ""
    *bracketed, in_parentheses = match.groups()
    sure = next((text.strip() for text in bracketed if text is not None), None)
    unit = sure if sure is not None else in_parentheses.strip()
    if unit.isdigit() or (sure is None and not reads_like_unit(unit)):
        return ""
    return "" if unit.lower() in NOT_GIVEN else unit


def without_unit(name: str) -> str:
    """A name without the unit in brackets at its end."""
    return re.sub(rf"\s*(?:{MARKED_UNIT.pattern})$", "", name) if unit_in(name) else name


def unit_of_cell(cell: str) -> str:
    """Unit in a cell of a row of units: "[deg]", "(deg)" or "deg"; "" for a sign of none."""
    match = MARKED_UNIT.fullmatch(cell)
    unit = next(text for text in match.groups() if text is not None) if match else cell
    return "" if unit.strip().lower() in NOT_GIVEN else unit.strip()


def are_units(row: Sequence[str]) -> bool:
    """Whether cells are units, not names: half of them can be units and one certainly is."""
    marked = {unit_of_cell(cell) for cell in row if MARKED_UNIT.fullmatch(cell)} - {""}
    bare = [unit for cell in row if (unit := unit_of_cell(cell))]
    possible = [unit for unit in bare if unit in marked or reads_like_unit(unit)]
    certain = [unit for unit in bare if unit in marked or SURE_UNIT.fullmatch(unit.lower())]
    return bool(certain) and 2 * len(possible) >= len(bare)


def reads_like_unit(text: str) -> bool:
    """Whether a text is a known unit, or consists of unit words, powers and fractions."""
    if spelled(text):
        return True
    words = [w for w in re.split(r"[\s/*·.^:²³⁻\d+-]+", text.lower()) if w]
    return bool(words) and set(words) <= {*_NAMES, *ONE_WORD, *UNIT_WORDS.split()}
