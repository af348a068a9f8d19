"""What a scene shows at one moment, in words and colours."""

from collections.abc import Mapping
from html import escape
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
"""Factor of the drawn surface angles and sideslip; shown in the scene."""
LONGEST_DETAIL, LONGEST_LABEL = 120, 36
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


class Caption(NamedTuple):
    """Words of a scene: headline, risk if known, detail, and what is not known, if anything."""

    word: str
    risk: str
    detail: str
    unknown: str = ""


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


def caption(shown: Shown) -> Caption:
    """A number only for an assessed sample; a word unless the flight is calm."""
    now = shown.headline
    both = "" if now.status is Status.OK else in_words(now, shown.cause)
    if shown.state is not State.OK or shown.p_value is None:
        return Caption(both, "", shown.reason or "no risk known", unknown(shown))
    return Caption(
        both,
        f"RISK {as_text(shown.p_value, shown.alert_above)}",
        f"alert above {shown.alert_above:.3g}",
        unknown(shown),
    )


def label(shown: Shown) -> str:
    """As much of the caption as fits the narrowest scene, the current status in any case."""
    words, now = caption(shown), shown.headline
    first = in_words(now._replace(exceeded_t=None), shown.cause)
    headline = in_words(now, shown.cause)
    texts = (f"{words.word} {words.risk}".strip(), words.word, headline, first)
    return next((text for text in texts if len(text) <= LONGEST_LABEL), first)


def as_text(p_value: float, alert_above: float) -> str:
    """Two decimals, or more where rounding would give 0 or cross the threshold."""
    text = ""
    for digits in range(2, 6):
        text = f"{p_value:.{digits}f}"
        if float(text) > 0.0 and (float(text) > alert_above) == (p_value > alert_above):
            break
    return text


def readout(words: Caption, colour: Colour) -> str:
    """The words as HTML for viser's panel; `detail` is escaped since it may be external text."""
    tint = f"rgb{colour}"
    style = f"background:{tint};color:#0b0f14;padding:0 8px;margin:0 -8px 2px;border-radius:4px"
    word = f'<div style="{style};font-size:24px;font-weight:800">{words.word}</div>'
    small = '<span style="font-size:12px;font-weight:400;color:#cdd6e0">(higher is worse)</span>'
    large = f"white-space:nowrap;font-size:20px;font-weight:700;color:{tint}"
    risk = f'<div style="{large}">{words.risk} {small}</div>'
    missing = f'<div style="font-size:13px;font-weight:700">{words.unknown}</div>'
    return (
        '<div style="font-family:system-ui,sans-serif;padding:0 12px 4px;line-height:1.3">'
        + word * bool(words.word)
        + risk * bool(words.risk)
        + f'<div style="font-size:13px">{escape(words.detail[:LONGEST_DETAIL])}</div>'
        + missing * bool(words.unknown)
        + '<div style="font-size:11px;opacity:.7">surfaces and sideslip drawn '
        f"×{EXAGGERATION:g}</div></div>"
    )


def tone(shown: Shown) -> Colour:
    """Colour of trail and risk column: that of the headline; grey without a risk.

    An exceedance is red or amber whatever the risk: it is measured.
    """
    status, level, *_ = shown.headline
    exceeds = status in (Status.EXCEEDING, Status.EXCEEDED)
    if (shown.state is not State.OK or shown.p_value is None) and not exceeds:
        return GREY
    return COLOURS[level] if level in (Level.WARNING, Level.CAUTION) else CALM
