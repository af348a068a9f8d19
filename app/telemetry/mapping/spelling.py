"""Split a signal's name into a path, words and a unit.

"/fdm/jsbsim/velocities/p-rad_sec" is the word p in rad/s on a path; "Ahrs1_bRollRate [deg/s]" the
words ahrs, 1, b, roll, rate in deg/s; "vehicle_angular_velocity/xyz[2]" the word z on a path.
"""

import re
import unicodedata
from dataclasses import dataclass
from functools import cache

from app.telemetry.units import NOT_GIVEN, spelled

GREEK = {
    "α": "alpha", "β": "beta", "δ": "delta", "Δ": "delta", "φ": "phi", "ϕ": "phi", "Φ": "phi",
    "θ": "theta", "ϑ": "theta", "Θ": "theta", "ψ": "psi", "Ψ": "psi", "ω": "omega",
    "ξ": "xi", "ζ": "zeta", "ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss",
}  # fmt: skip
AXES = ("x", "y", "z")
VECTORS = {
    *("xyz", "gyro", "gyr", "acc", "accel", "accelerometer", "acceleration"),
    *("rate", "rates", "omega", "velocity", "pqr", "rpy"),
}
"""Words that are followed by the number of an axis in brackets."""
FROM_TRIM = re.compile(r"[_ ]from[_ ]trim(?=_|\b)", re.IGNORECASE)
"""A deviation from trim is the same quantity; a trim is not."""
LETTERS = {"pqr": ("p", "q", "r"), "rpy": ("roll", "pitch", "yaw")}


@dataclass(frozen=True)
class Spelling:
    """One way to read a name.

    path: words of the group and the path.   words: of the name itself, all in lower case.
    unit: as the name spells it; "" if it gives none.
    """

    path: tuple[str, ...]
    words: tuple[str, ...]
    unit: str = ""


@cache
def spellings(name: str, group: str = "") -> tuple[Spelling, ...]:
    """The ways to read a name: with its last words as a unit, and with all as words."""
    name = re.sub(r"\s\(\d+\)$", "", name)  # "beta (2)" is a second beta
    path, bare = place(FROM_TRIM.sub("", name))
    # vehicle_acceleration_0 is the first of its kind
    before = tuple(w for part in (group, *path) for w in _words(part) if not w.isdigit())
    bare, index = _index(bare)
    bare, bracketed = _bracketed(bare)
    if bracketed and (spelled(bracketed) or bracketed.lower() in NOT_GIVEN):
        return (Spelling(before, _with_index(_words(bare), index), bracketed),)
    rest = f"{bare} {bracketed}"
    ways = [
        Spelling(before, _with_index(_words(stem), index), unit)
        for stem, unit in unit_suffixes(rest)
    ]
    plain = Spelling(before, _with_index(_words(rest), index))
    lower = Spelling(before, _with_index(_words(rest.lower()), index))
    return tuple(dict.fromkeys([*ways, plain, lower]))


def place(name: str) -> tuple[list[str], str]:
    """Split off the path before the last / or : or dot, and the device after a backslash."""
    name, *device = name.strip().split("\\")
    units = re.search(r"\s*[\[(<{][^\[(<{]*[\])>}]\s*$|\s+/\s+\S+$", name)
    head, tail = (name[: units.start()], units[0]) if units else (name, "")
    if re.fullmatch(r"\s+/\s+\S+", tail):  # DIN: "beta / deg"
        tail = f" [{tail.split('/', 1)[1].strip()}]"
    elif (slashed := re.search(r"[_\s,\-]+([^_\s,\-/]+/[^_\s,\-]+)$", head)) and spelled(
        slashed[1]
    ):
        head, tail = head[: slashed.start()], f" [{slashed[1]}]{tail}"  # "p_rad/s"
    *path, last = re.split(r"[/:|]+|(?<=\w)\.(?=[A-Za-z_])", head)
    return [*device, *path], last + tail


def _index(name: str) -> tuple[str, str]:
    """Split off a number in brackets, which counts axes or parts of a quaternion."""
    match = re.search(r"\s*[\[(](\d{1,2})[\])]\s*$", name)
    return (name[: match.start()], match[1]) if match else (name, "")


def _bracketed(name: str) -> tuple[str, str]:
    """Split off text in brackets or after a comma: "beta (deg)", "Beta,__deg"."""
    match = re.search(r"[\[({<]([^\[({<]*)[\])}>]\s*$", name) or re.search(r",([^,]+)$", name)
    return (name[: match.start()], match[1].strip(" _")) if match else (name, "")


def unit_suffixes(name: str) -> list[tuple[str, str]]:
    """(stem, unit) for each way in which a name ends in a unit: ay_m_s2, BetaDeg, altft."""
    name = name.strip()
    ends = [match.start() for match in re.finditer(r"[_\s\-]+(?=[^_\s\-])", name)][-4:]
    suffixes = []
    for end in ends:
        unit = name[end:].strip(" _-")
        if end and spelled(unit):
            suffixes.append((name[:end], unit))
    camel = re.search(r"(?<=[a-z])[A-Z][A-Za-z0-9]*$", name)
    if not suffixes and camel and spelled(camel[0]):
        suffixes.append((name[: camel.start()], camel[0]))
    if not suffixes:
        match = re.search(r"(?<=\w)(degps|deg|radps|rad|mps2|mps|kts|dps)$", name.lower())
        if match:
            suffixes.append((name[: match.start()], match[0]))
    return suffixes


def _words(text: str) -> tuple[str, ...]:
    """Split at changes of case and kind, in lower case: "AccY2_cg" -> acc, y, 2, cg."""
    for letter, latin in GREEK.items():
        text = text.replace(letter, f"{latin}" if len(latin) < 3 else f"_{latin}_")
    text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    text = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", text)
    text = re.sub(r"(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", "_", text)
    return tuple(word for word in re.split(r"[^a-z0-9]+", text.lower()) if word)


def _with_index(words: tuple[str, ...], index: str) -> tuple[str, ...]:
    if not index or not words:
        return words
    number = int(index)
    if words[-1] in VECTORS or words[0] in VECTORS:
        names = LETTERS.get(words[-1], AXES)
        if number < len(names):
            stem = words[:-1] if words[-1] in ("xyz", *LETTERS) else words
            return (*stem, names[number])
    return (*words, index)
