"""The right to speak: whether a segment is a flight of the kind that its monitor knows."""

from collections.abc import Iterator

import numpy as np

from app.scoring.assessed_segment import AssessedSegment
from app.scoring.planned_test import SURFACE_NAMES, SURFACES, first_direction
from app.scoring.scored import Check
from app.scoring.seen import unassessed
from app.telemetry.resampling.resampling import RATE_RATIO
from core.channels import CHANNELS, KEYS

SPEED_SHARE = 0.1
"""Of the model's airspeed: beyond, its derivatives are those of another flight condition."""
LARGER, FAR_LARGER = 2.0, 10.0
"""Times the largest in training: worth a remark; not of this unit, or not of this manoeuvre."""
DEGREES = 30.0
"""Times as large: probably degrees that were taken for radians."""
FLOWN_SHARE = 0.3
"""Of the planned amplitude: a surface that moves less was not flown, one that should not move and
moves more makes another manoeuvre."""
TRIM_SHARE = 0.25
"""Of a channel's largest in training: what moves more before the first input is not in trim."""
RESTS = 0.005
"""[rad, rad/s, g] What moves less is at rest, however little it moved in training."""
N_RESPONSES = 4
"""Channels before the surfaces."""
ASSESSED_SHARE = 0.9
"""Of the samples that count: with fewer that could be assessed nothing is promised."""
LONGER = 2.0
"""Times as long as simulated: not one manoeuvre of this kind any more."""


def rate(flown: AssessedSegment) -> Check:
    """Whether the needed channels were recorded fast enough, and how much could be assessed."""
    t, dt = flown.said.t, flown.monitor.dt
    steps = {}
    for key in (KEYS[c] for c in np.flatnonzero(flown.needed)):
        trace = flown.traces.channels[key]
        part = slice(*np.searchsorted(trace.t, (t[0] - dt, t[-1] + dt)).tolist())
        n_known = np.count_nonzero(np.isfinite(trace.values[part]))
        if n_known > 1:
            recorded = trace.t[part]
            step = float(recorded[-1] - recorded[0]) / (n_known - 1)
            steps[key] = step * flown.held.get(key, 1)
    n_assessed, n = int(np.isfinite(flown.said.p_value).sum()), len(t)
    text = f"{n_assessed} of {n} samples could be assessed"
    if not steps:
        return Check("rate", False, text)
    slowest = max(steps, key=lambda key: steps[key])
    rates = f"{slowest} recorded at {1 / steps[slowest]:.4g} Hz, the monitor's {1 / dt:.4g} Hz"
    fast_enough = True if steps[slowest] <= 1.05 * dt else None
    if (rows := flown.held.get(slowest, 1)) > 1:
        rates += f" (each value stands in {rows} rows)"
        fast_enough = fast_enough if steps[slowest] <= RATE_RATIO * dt else False
    return Check("rate", fast_enough if n_assessed else False, f"{rates}; {text}")


def assessed(flown: AssessedSegment) -> Check:
    """Whether enough could be assessed, up to the first sample past a limit."""
    lost = unassessed(flown.said)[: flown.end + 1]
    n_lost, n = int(lost.sum()), len(lost)
    if n_lost <= (1.0 - ASSESSED_SHARE) * n:
        return Check("coverage", True, f"at least {ASSESSED_SHARE:.0%} of the samples")
    text = f"{n_lost} of {n} samples are missing or could not be assessed"
    return Check("coverage", None, f"{text}: at most {1.0 - ASSESSED_SHARE:.0%} may")


def channels(flown: AssessedSegment) -> Check:
    """Whether every needed channel is there, and which were not measured themselves."""
    there = np.isfinite(flown.y).any(axis=0)
    if lost := [KEYS[c] for c in np.flatnonzero(flown.needed & ~there)]:
        what = "has no sample here, or none that its trim could be taken from"
        return Check("channels", False, f"{', '.join(lost)} {what}")
    derived = [key for key in KEYS if key in flown.recording.derived]
    absent = [KEYS[c] for c in np.flatnonzero(~there)]
    remarks = [f"{', '.join(derived)} derived, not measured"] if derived else []
    remarks += [f"{', '.join(absent)} not recorded and not needed"] if absent else []
    return Check("channels", True, "; ".join(["all that are needed", *remarks]))


def units(flown: AssessedSegment) -> Check:
    """Whether the values are of the size of training's, by orders: the support judges finely."""
    reach = flown.monitor.training_max_abs
    ratio = np.divide(flown.largest, reach, out=np.zeros_like(reach), where=reach > 0.0)
    worst = int(ratio.argmax())
    if ratio[worst] <= LARGER:
        return Check("units", True, f"every channel within {LARGER:g} times its training")
    channel = CHANNELS[worst]
    text = (
        f"{channel.key} reaches {flown.largest[worst]:.3g} {channel.unit}, {ratio[worst]:.3g} "
        "times its largest in training"
    )
    if ratio[worst] <= FAR_LARGER:
        return Check("units", None, text)
    guess = channel.unit.startswith("rad") and DEGREES <= ratio[worst] <= 2 * np.degrees(1.0)
    hint = ", or is it in degrees?" if guess else ""
    return Check("units", False, f"{text}: check its unit and the manoeuvre{hint}")


def flight_condition(flown: AssessedSegment) -> Check:
    """Whether the aircraft flew as fast as the model."""
    name, part = "flight condition", slice(flown.segment.first, flown.segment.last + 1)
    condition = {key: values[part] for key, values in flown.recording.condition.items()}
    means = {key: v[np.isfinite(v)].mean() for key, v in condition.items() if np.isfinite(v).any()}
    height = f"; altitude {means['h']:.0f} m, not judged" if "h" in means else ""
    if "V" not in means:
        return Check(name, None, f"no airspeed is recorded{height}")
    speed, model = means["V"], flown.plan.speed
    if model is None:
        return Check(name, None, f"{speed:.1f} m/s; the model's speed is not known{height}")
    off = speed / model - 1.0
    text = f"{speed:.1f} m/s, {off:+.1%} from the model's {model:.1f} m/s{height}"
    return Check(name, bool(abs(off) <= SPEED_SHARE), text)


def manoeuvre(flown: AssessedSegment) -> Iterator[Check]:
    """Whether it was the planned manoeuvre: the surface, its direction, the length."""
    plan = flown.plan
    if plan.duration is None:
        yield Check("manoeuvre", None, "the monitor does not know what was planned")
        return
    yield Check("manoeuvre", *_surfaces(flown))
    length = float(flown.said.t[-1] - flown.said.t[0])
    text = f"{length:.2f} s, simulated {plan.duration:.2f} s"
    longer = length - plan.duration > 0.5 * plan.dt
    if length > LONGER * plan.duration:
        yield Check("length", False, f"{text}: mark the manoeuvre alone")
    elif longer:
        yield Check("length", None, f"{text}: what comes later is not covered")
    else:
        yield Check("length", True, text)


def _surfaces(flown: AssessedSegment) -> tuple[bool | None, str]:
    amplitudes, texts, oks = flown.plan.amplitudes, [], []
    for column, (c, name) in enumerate(zip(SURFACES, SURFACE_NAMES, strict=True)):
        moved, planned = flown.largest[c], amplitudes[column]
        if not np.isfinite(moved):
            oks.append(None)
            texts.append(f"{name} not recorded")
            continue
        text = f"{name} moved by {np.degrees(moved):.2g}°"
        oks.append(True)
        if planned > 0.0:
            text += f", planned {np.degrees(planned):.2g}°"
            flown_way = first_direction(flown.y[:, c])
            planned_way = first_direction(flown.plan.commands[:, column])
            if moved < FLOWN_SHARE * planned:
                oks[-1] = False
                text += ": it was hardly flown"
            elif flown_way != planned_way:
                oks[-1] = False
                text += ": it went the other way first, or its sign is reversed"
        elif moved > max(
            FLOWN_SHARE * amplitudes.max(initial=0.0), LARGER * flown.monitor.training_max_abs[c]
        ):
            oks[-1] = False
            text += ", which the planned manoeuvre leaves alone"
        elif moved > LARGER * flown.monitor.training_max_abs[c]:
            text += f", at most {np.degrees(flown.monitor.training_max_abs[c]):.2g}° in training"
        texts.append(text)
    ok = False if False in oks else None if None in oks else True
    return ok, "; ".join(texts)


def trim(flown: AssessedSegment) -> Check:
    """Whether the aircraft rested before the first input."""
    segment = flown.segment
    if segment.rest is None:
        return Check("trim", None, "taken as it is: nothing was subtracted")
    length = (segment.rest.stop - segment.rest.start) * flown.monitor.dt
    when = "of the first" if segment.onset is None else "before the first input, of"
    text = f"mean {when} {length:.2f} s"
    rest = flown.recording.y[segment.rest, :N_RESPONSES]
    known = np.isfinite(rest)
    spread = rest.max(0, initial=-np.inf, where=known) - rest.min(0, initial=np.inf, where=known)
    largest = np.maximum(TRIM_SHARE * flown.monitor.training_max_abs[:N_RESPONSES], RESTS)
    share = np.where(flown.needed[:N_RESPONSES], spread / largest, 0.0)
    worst = int(share.argmax())
    moved = f"{CHANNELS[worst].key} moves by {spread[worst]:.2g} {CHANNELS[worst].unit} in it"
    if share[worst] > 1.0:
        return Check("trim", False, f"{text}, but {moved}: the flight does not begin at rest")
    return Check("trim", True, text)
