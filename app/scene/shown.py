"""What a scene shows at one moment, in words and colours."""

from collections.abc import Mapping
from typing import NamedTuple

from core.monitor.assessment import Cause, State
from core.monitor.status import Facts, Headline, Level, Status, headline, in_words

KnownAngles = tuple[float | None, float | None, float | None]
"""Bank, pitch and heading [rad]; None for one that the flight does not know."""
Colour = tuple[int, int, int]
CALM: Colour = (24, 156, 144)
ALERT: Colour = (255, 40, 32)
CAUTION: Colour = (228, 142, 12)
ADVISORY: Colour = (72, 136, 236)
GREY: Colour = (128, 132, 140)
GHOST: Colour = (92, 95, 101)
INK: Colour = (124, 135, 149)
FAINT: Colour = (128, 122, 104)
VELOCITY: Colour = (72, 132, 236)
LIMIT: Colour = (232, 160, 8)
GRID: Colour = (158, 152, 134)
EARTH: Colour = (92, 84, 62)
PLANNED: Colour = (214, 226, 240)
"""Visible on a dark and on a light sky: the sky is the page's background, in the viewer's theme."""

EXAGGERATION = 3.0
"""Factor of the drawn surface angles and sideslip."""
LONGEST_LABEL = 36
COLOURS = {
    Level.WARNING: ALERT,
    Level.CAUTION: CAUTION,
    Level.ADVISORY: ADVISORY,
    Level.NONE: CALM,
}
"""Colours of ring and words: red is for warnings only."""


POSE = ("t", "attitude", "beta", "delta_a", "delta_r", "delta_e", "alpha")
"""Fields that say where and how the aircraft is drawn."""


class Shown(NamedTuple):
    """All that a picture depends on; see Scene.show.

    beta, alpha, delta_a, delta_r, delta_e: [rad]; None where the flight does not know it.
    planned: attitude of the planned flight at this time; None without one.
    """

    t: float
    attitude: KnownAngles
    beta: float | None
    delta_a: float | None
    delta_r: float | None
    p_value: float | None
    alert_above: float
    alert: bool
    state: State
    reason: str
    facts: Facts
    cause: Cause | None = None
    delta_e: float | None = None
    alpha: float | None = None
    planned: KnownAngles | None = None

    @property
    def headline(self) -> Headline:
        return headline(self.facts)


def unknown(shown: Shown) -> str:
    """`bank, heading and surfaces not known`: what the picture leaves out; empty for nothing."""
    bank, pitch, heading = shown.attitude
    angles = {"bank": bank, "pitch": pitch, "heading": heading}
    surfaces = {"aileron": shown.delta_a, "rudder": shown.delta_r}
    names = [
        *_unknown_of(angles, "attitude"),
        *_unknown_of({"sideslip": shown.beta}),
        *_unknown_of(surfaces, "surfaces"),
    ]
    *others, last = names or [""]
    return f"{' and '.join(filter(None, [', '.join(others), last]))} not known" if last else ""


def _unknown_of(values: Mapping[str, float | None], together: str = "") -> list[str]:
    """Names of the unknown ones; a word for all `together`."""
    names = [name for name, value in values.items() if value is None]
    return [together] if together and len(names) == len(values) else names


def label(shown: Shown) -> str:
    """Headline and risk, as much as fits the narrowest scene; the current status in any case.

    A number only for an assessed sample; a word unless the flight is calm.
    """
    now = shown.headline
    first = in_words(now._replace(exceeded_t=None), shown.cause)
    headline = in_words(now, shown.cause)
    word = "" if now.status is Status.OK else headline
    risk = "" if word else "no risk known"
    if shown.state is State.OK and shown.p_value is not None:
        risk = f"RISK {as_text(shown.p_value, shown.alert_above)}"
    texts = (f"{word} {risk}".strip(), word, headline, first)
    return next((text for text in texts if len(text) <= LONGEST_LABEL), first)


def as_text(p_value: float, alert_above: float) -> str:
    """Two decimals, or more where rounding would give 0 or cross the threshold."""
    text = ""
    for digits in range(2, 6):
        text = f"{p_value:.{digits}f}"
        if float(text) > 0.0 and (float(text) > alert_above) == (p_value > alert_above):
            break
    return text


def tone(shown: Shown) -> Colour:
    """Colour of trail and risk column: that of the headline; grey without a risk.

    An exceedance is red or amber whatever the risk: it is measured.
    """
    status, level, *_ = shown.headline
    exceeds = status in (Status.EXCEEDING, Status.EXCEEDED)
    if (shown.state is not State.OK or shown.p_value is None) and not exceeds:
        return GREY
    return COLOURS[level] if level in (Level.WARNING, Level.CAUTION) else CALM
