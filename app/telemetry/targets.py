"""The quantities that a signal of a file can be mapped to, and the values that they can reach.

A key means its quantity in TARGETS, else in the built-in dictionaries, else that of a user's own
dictionary. The bounds allow for every aircraft and convention, also for a heading that is never
wrapped. Values beyond them are failed sensors or no measurements, and are not scored.
"""

from collections.abc import Iterable
from dataclasses import replace
from math import radians

import numpy as np

from app.telemetry.contents import release
from app.telemetry.recording import TelemetryError, Trace
from app.telemetry.units import PLAIN, factor, fits, si_unit
from core.channels import CHANNELS, Channel, Dictionary, channel, known_channels
from core.counted import counted
from core.types import Array, Indices

ATTITUDE_TARGETS = (
    channel("phi", "φ", "rad", "bank angle"),
    channel("theta", "θ", "rad", "pitch angle"),
    channel("psi", "ψ", "rad", "heading"),
)
CONDITION_TARGETS = (
    channel("V", "V", "m/s", "true airspeed"),
    channel("h", "h", "m", "altitude"),
)
INGREDIENTS = (
    channel("v", "v", "m/s", "lateral velocity"),
    channel("Ay", "a_y", "g", "lateral acceleration, gravity included"),
    channel("delta_a_left", "δ_a,l", "rad", "left aileron"),
    channel("delta_a_right", "δ_a,r", "rad", "right aileron"),
    channel("delta_r_left", "δ_r,l", "rad", "left rudder"),
    channel("delta_r_right", "δ_r,r", "rad", "right rudder"),
    channel("q0", "q_0", "1", "attitude quaternion, scalar part"),
    channel("q1", "q_1", "1", "attitude quaternion, forward part"),
    channel("q2", "q_2", "1", "attitude quaternion, right part"),
    channel("q3", "q_3", "1", "attitude quaternion, down part"),
)
"""Only used to derive other channels."""
TARGETS: dict[str, Channel] = {
    target.key: target
    for target in (*CHANNELS, *ATTITUDE_TARGETS, *CONDITION_TARGETS, *INGREDIENTS)
}
"""By key, of the lateral motion; values are stored in `unit`."""
KNOWN: dict[str, Channel] = TARGETS | {
    key: known for key, known in known_channels().items() if key not in TARGETS
}
"""TARGETS, then the other channels of the built-in dictionaries."""


def target_of(key: str, unit: str) -> Channel:
    """Channel of a key for a signal recorded in `unit`; values are stored in its own unit.

    A key that is not known, or one outside TARGETS whose unit is of another kind (q in Pa), is a
    channel of a user's own dictionary: its values are stored in SI units, and converted when
    they are read. TelemetryError if `unit` is unknown.
    """
    known = KNOWN.get(key)
    if known and (key in TARGETS or not unit.strip() or fits(unit, known.unit)):
        return known
    return channel(key, key, si_unit(unit), key)


def label_of(key: str) -> str:
    return KNOWN[key].label if key in KNOWN else key


def may_be_one_quantity(key: str, other: str) -> bool:
    """Whether one of two keys may be a user's own name for the other, which is known."""
    return (key in KNOWN) != (other in KNOWN)


def as_mapped(own: Channel) -> Channel:
    """A channel of any dictionary, in the unit in which its mapped values are stored.

    It is unchanged if its unit is not one of its key's quantity, or unknown.
    """
    try:
        unit = target_of(own.key, own.unit or PLAIN).unit
        per_unit = factor(unit, own.unit)
    except TelemetryError:
        return own
    largest = own.largest and own.largest / per_unit
    display = own.display_factor * per_unit
    return replace(own, unit=unit, display_factor=display, largest=largest)


def in_order(keys: Iterable[str]) -> list[str]:
    """Keys in the order of KNOWN, then the others."""
    given = dict.fromkeys(keys)
    return [*(key for key in KNOWN if key in given), *(key for key in given if key not in KNOWN)]


BY_UNIT: dict[str, float] = {
    "rad": radians(100.0),  # of the sideslip or a surface
    "rad/s": 20.0,  # three turns a second
    "g": 30.0,  # more than aircraft and sensors withstand
    "m/s": 2000.0,
    "m": 100_000.0,
}
ACCUMULATED = 1e4
"""Bound of an angle that may accumulate full turns [rad]."""
BOUNDS: dict[str, float] = {
    target.key: ACCUMULATED if target in ATTITUDE_TARGETS else BY_UNIT.get(target.unit, np.inf)
    for target in KNOWN.values()
}
"""Largest plausible magnitude of a known target, in its unit; quaternions have none."""


def largest_plausible(channel: Channel) -> float:
    """Largest plausible magnitude of a channel, in its unit; infinite if unknown."""
    known, given = KNOWN.get(channel.key), channel.largest or np.inf
    if known is None or known.unit != channel.unit:
        return given
    return BOUNDS[channel.key] if channel == known else min(BOUNDS[channel.key], given)


def check_limits(channel: Channel, *ends: float | None) -> None:
    """TelemetryError for a limit that no plausible value of a measured channel can exceed."""
    bound = np.inf if channel.formula else largest_plausible(channel)
    for end in ends:
        if end is None or not bound <= abs(end) < np.inf:
            continue
        remedy = "; only rollouts of a channel with another name may reach more"
        if bound == channel.largest:
            remedy = ", or the channel a larger `largest` in the dictionary"
        raise TelemetryError(
            f"the limit {channel.key} {channel.read(end)} was given, and values beyond "
            f"{channel.read(bound)} count as those of a failed sensor, so no value would exceed "
            f"it: give a smaller limit{remedy}"
        )


def beyond_plausible(dictionary: Dictionary, y: Array) -> list[str]:
    """Measured channels that leave their plausible values, in words.

    y: (n, n_samples, n_channels).
    """
    texts = []
    for c, known in enumerate(dictionary.channels):
        bound = np.inf if known.formula else largest_plausible(known)
        peaks = np.fmax.reduce(np.abs(y[..., c]), axis=1)
        if n := int((peaks > bound).sum()):
            texts.append(
                f"{known.key} reaches {known.read(np.fmax.reduce(peaks))}, and exceeds "
                f"{known.read(bound)} in {counted(n, 'flight')}; in flight such values count as "
                "those of a failed sensor: nothing is assessed by them, and an alarm of a limit "
                "that they exceed says so"
            )
    return texts


def implausible(key: str, values: Array, unit: str = "") -> Indices:
    """Rows with a value that no aircraft can reach.

    unit: of the values; "" for that of the known target. Other quantities have no bound.
    """
    known = KNOWN.get(key)
    bound = BOUNDS[key] if known and unit in ("", known.unit) else np.inf
    reach = max(-np.fmin.reduce(values, initial=0.0), np.fmax.reduce(values, initial=0.0))
    return np.flatnonzero(np.abs(values) > bound) if reach > bound else np.empty(0, np.intp)


def plausible(key: str, trace: Trace) -> Trace:
    """A channel with implausible values replaced by NaN; unchanged if there are none."""
    rows = implausible(key, trace.values, trace.unit)
    release(trace.values)
    return without(trace, rows)


def without(trace: Trace, rows: Indices) -> Trace:
    """A channel without the values of some rows, which it keeps as sent; unchanged if none."""
    if not len(rows):
        return trace
    remaining = np.array(trace.values, np.float64)
    remaining[rows] = np.nan
    sent = trace.values if trace.sent is None else trace.sent
    return replace(trace, values=remaining, sent=sent)
