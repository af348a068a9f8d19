"""Recorded flights of any dictionary and any limits, as the page plays them from a file.

No monitor flies them: the risk rises with the margin that the flight has half a second later.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from app.messages import limited_channels
from core.channels import LONGITUDINAL, Dictionary, channel
from core.limits.limits import Envelope, IntervalLimits, SafeInterval, envelope_of
from core.types import Array
from tests.support.demonstration_recording import FILE

DT, N, LEAD, NEVER = 0.05, 121, 10, 10_000
"""[s], samples, samples, and a sample after the end: the page tells of two alarms."""
SPEED = 0.1
"""Slow: a test holds the flight soon after its start."""
ALERT_ABOVE = 0.1
UP_AND_DOWN = {"Nz": SafeInterval(-1.4, 4.9, 1.0)}
"""Unequal limits of the load factor [g]."""
GROUPS = ("angles", "rates", "acceleration", "surfaces", "loads", "engine")
UNITS = ("rad", "rad/s", "g", "rad", "N*m", "Pa")
FIVE = {
    "x1": SafeInterval(-0.25, 0.28),
    "x2": SafeInterval(-0.4, 0.4),
    "x3": SafeInterval(None, 0.27),
    "x5": SafeInterval(3000.0, None, 4500.0),
    "x8": SafeInterval(-0.5, 0.5),
}
"""Limits of five of the channels of `many`."""


def longitudinal() -> Array:
    """(N, 6) a pull and a push: N_z to 5.2 g, then to -1.6 g."""
    t = np.arange(N) * DT

    def swing(start: float) -> Array:
        s = np.maximum(t - start, 0.0)
        return np.exp(-1.1 * s) * np.sin(2.6 * s)

    push = np.where(t < 2.2, 0.0, swing(2.2))
    alpha = 0.05 + 0.19 * swing(0.8) - 0.17 * push
    stick = np.where((t > 0.7) & (t < 2.2), -0.12, np.where((t >= 2.2) & (t < 3.4), 0.14, 0.0))
    q = np.gradient(alpha, DT)
    theta = 0.06 + np.cumsum(q) * DT * 0.8
    load = 1.0 + 38.0 * (alpha - 0.05)
    speed = 152.0 - 6.0 * np.cumsum(np.abs(alpha - 0.05)) * DT
    return np.stack((alpha, q, theta, load, speed, stick - 0.03), axis=1)


def many(n: int) -> Dictionary:
    """Channels in six groups; every sixth is a control."""
    return Dictionary(
        f"{n} channels",
        tuple(
            channel(
                f"x{k + 1}",
                f"x_{k + 1}",
                UNITS[k % 6],
                f"{GROUPS[k % 6]} {k + 1}",
                "control" if k % 6 == 3 else "output",
                "absolute" if k % 6 > 3 else "trim",
                GROUPS[k % 6],
            )
            for k in range(n)
        ),
    )


def oscillating(dictionary: Dictionary) -> Array:
    """(N, n) each channel swings about its own value at its own rate."""
    t = np.arange(N)[:, None] * DT
    k = np.arange(len(dictionary))
    rest = np.where(k % 6 > 3, 900.0 * (k + 1), 0.0)
    size = np.where(k % 6 > 3, 40.0 * (k + 1), 0.3)
    return rest + size * np.sin((0.5 + 0.13 * k) * t + k) * np.minimum(t / 2.0, 1.0)


def recording(
    dictionary: Dictionary = LONGITUDINAL,
    intervals: Mapping[str, SafeInterval] = UP_AND_DOWN,
    y: Array | None = None,
) -> dict[str, Any]:
    """A flight of the page's format. intervals: none for a monitor that knows labels only."""
    y = longitudinal() if y is None else y
    specification = IntervalLimits(dictionary, intervals) if intervals else None
    limits = envelope_of(specification)
    t = np.arange(len(y)) * DT
    risk = _risk(y, limits)
    plain = json.loads(FILE.read_text())
    by_key = {key: asdict(interval) for key, interval in intervals.items()} or None
    monitor = plain["hello"]["monitors"][0] | {
        "limits": by_key,
        "lead": LEAD * DT,
        "alert_above": ALERT_ABOVE,
        "name": dictionary.name,
    }
    hello = plain["hello"] | {
        "channels": [each.model_dump() for each in limited_channels(dictionary, specification)],
        "monitors": [monitor],
        "lead": LEAD * DT,
        "dt": DT,
        "theta": None,
        "transport": plain["hello"]["transport"] | {"speed": SPEED},
        "guarantee": "average",
        "no_rest": "no forecast with this method",
    }
    y_hat = y[np.minimum(np.arange(len(y)) + LEAD, len(y) - 1)]
    whole = {
        "t": t.round(6).tolist(),
        "y": y.round(6).tolist(),
        "p_value": risk.round(4).tolist(),
        "alert": (risk > ALERT_ABOVE).tolist(),
        "state": ["ok"] * len(y),
        "y_hat": y_hat.round(6).tolist(),
    }
    messages, headlines = _events(dictionary, intervals, y, risk)
    return plain | {
        "hello": hello,
        "messages": messages,
        "headlines": headlines,
        "frames": {"whole": whole, "sparse": {}},
    }


def _risk(y: Array, limits: Envelope | None) -> Array:
    margin = np.abs(y - y[0]).max(axis=1) / 4.5 if limits is None else limits.margin(y)
    ahead = margin[np.minimum(np.arange(len(y)) + LEAD, len(y) - 1)]
    return np.clip(np.maximum(margin, ahead) - 0.5, 0.005, 0.9) ** 2


def _events(
    dictionary: Dictionary, intervals: Mapping[str, SafeInterval], y: Array, risk: Array
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Alarms, and the headline where it changes."""
    plain = json.loads(FILE.read_text())
    alarms = [m["message"]["alarm"] for m in plain["messages"] if m["message"]["type"] == "alarm"]
    begun = plain["messages"][:1]
    ok = plain["headlines"][0]
    messages, headlines, latched = [*begun], [ok], []
    over = np.flatnonzero(risk > ALERT_ABOVE)
    alert = int(over[0]) if len(over) else NEVER
    if alert < NEVER:
        headlines.append(plain["headlines"][1] | {"seq": alert})
    value = float(risk[over[0]]) if len(over) else 0.0
    raised = alarms[0] | {"seq": alert, "t": alert * DT, "p_value": value}
    messages.append({"seq": alert, "message": {"type": "alarm", "alarm": raised}})
    first = True
    for number, (k, exceedance) in enumerate(_exceedances(dictionary, intervals, y), 2):
        raised = alarms[1] | {
            "id": str(number),
            "number": number,
            "seq": k,
            "t": k * DT,
            "exceedance": exceedance,
        }
        messages.append({"seq": k, "message": {"type": "alarm", "alarm": raised}})
        if first and k < len(y):
            latched = [
                {
                    "channel": exceedance["channel"],
                    "t": k * DT,
                    "value": exceedance["value"],
                    "over": True,
                    "acknowledged": False,
                }
            ]
            now = {"status": "exceeding", "level": "warning", "beside": [], "latched": latched}
            now |= {"exceeded_t": k * DT, "verdict": None}
            headlines.append({"seq": k, "pair": [now, now]})
        first = False
    return messages, headlines


def _exceedances(
    dictionary: Dictionary, intervals: Mapping[str, SafeInterval], y: Array
) -> list[tuple[int, dict[str, Any]]]:
    """First sample beyond each end, in order of time: its number and the exceedance.

    NEVER where there is none.
    """
    found = []
    for key, interval in intervals.items():
        values = y[:, dictionary.index(key)]
        for limit, beyond in ((interval.low, -1.0), (interval.high, 1.0)):
            over = np.zeros(len(y), bool) if limit is None else beyond * (values - limit) >= 0
            if over.any():
                k = int(over.argmax())
                about = {"channel": key, "value": float(values[k]), "limit": limit}
                found.append((k, about | {"judged": "both"}))
    never = (NEVER, {"channel": dictionary.keys[0], "value": 0.0, "limit": 0.0})
    return sorted(found, key=lambda each: each[0]) or [never]
