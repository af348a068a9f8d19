"""The figure of a scored recording is self-contained; an installed program makes the PNG."""

import re
from pathlib import Path
from shutil import which
from xml.etree import ElementTree

import numpy as np
import pytest

from app.assessment.limits_history import pieces_of
from app.report.figures import MOST_STRIPS, NoPngError, channel_strip, png, score_figure
from app.report.strip_chart import StripChart
from core.channels import CHANNELS, LATERAL, LONGITUDINAL, Dictionary
from core.limits.limits import Envelope, IntervalLimits, Limits, SafeInterval
from tests.support.any_flight import many
from tests.support.oscillator import DT
from tests.support.samples import SAMPLE_LIKE

TEN_DEGREES = pieces_of(LATERAL, Envelope.of_magnitudes(np.full(6, np.radians(10.0))), None)
LIMITS = Limits(Ny=0.5).envelope
LEAD = 0.25


@pytest.fixture(scope="module")
def drawing() -> bytes:
    return drawn(LATERAL, LIMITS)


def drawn(dictionary: Dictionary, limits: Envelope | None) -> bytes:
    n, like = len(dictionary), SAMPLE_LIKE.fields
    assert like is not None
    wide = {"y": (np.float64, n), "y_hat": (np.float64, n)}
    samples = np.zeros(400, [(name, *wide.get(name, (like[name][0],))) for name in like])
    samples["t"] = DT * np.arange(400)
    samples["y"] = 0.1 * np.sin(samples["t"])[:, None]
    samples["y_hat"] = samples["y"]
    samples["withdrawn"] = np.nan
    doublet = {"name": "<doublet> & more", "start": 2.0, "end": 6.0, "exceedance": {"t": 4.0}}
    pieces = pieces_of(dictionary, limits, None)
    return score_figure(dictionary, samples, [doublet], pieces, 0.1, LEAD, "scored: <flight>.csv")


def test_it_is_a_file_of_its_own(drawing: bytes) -> None:
    svg = ElementTree.fromstring(drawing)
    assert svg.tag == "{http://www.w3.org/2000/svg}svg"
    assert b".chart .limit" in drawing
    assert b'id="hatch"' in drawing
    assert b"http" not in drawing.replace(b"http://www.w3.org/2000/svg", b"")


def test_every_channel_and_each_moment_is_drawn(drawing: bytes) -> None:
    svg = ElementTree.fromstring(drawing)
    kinds = [part.get("class") for part in svg.iter()]
    strips = len(CHANNELS) + 1
    assert kinds.count("frame") == kinds.count("manoeuvre") == strips
    words = "".join(svg.itertext())
    for text in ("scored: <flight>.csv", "limit exceeded", "predicted 0.25 s ahead", "1"):
        assert text in words
    assert len({part.get("d") for part in svg.iter() if part.get("class") == "limit"}) == 2


def test_limits_are_drawn_at_the_ends_of_their_interval() -> None:
    pieces = {
        end: IntervalLimits(LONGITUDINAL, {"Nz": SafeInterval(*end, 1.0)}).envelope
        for end in ((-1.4, 4.9), (None, 4.9), (-1.4, None))
    }
    drawings = {end: drawn(LONGITUDINAL, limits).decode() for end, limits in pieces.items()}
    lines = [
        max(path.count("M") for path in re.findall(r'class="limit" d="([^"]+)"', drawing))
        for drawing in drawings.values()
    ]
    assert lines == [2, 1, 1]
    words = "".join(ElementTree.fromstring(drawn(LONGITUDINAL, pieces[-1.4, 4.9])).itertext())
    for text in ("q [deg/s]", "V [m/s]"):
        assert text in words
    assert "from trim" not in words


def test_of_many_channels_the_limited_ones_and_controls_are_drawn() -> None:
    dictionary = many(32)
    limits = IntervalLimits(dictionary, {"x32": SafeInterval(None, 0.5)}).envelope
    words = "".join(ElementTree.fromstring(drawn(dictionary, limits)).itertext())
    shown = [known.key for known in dictionary.channels if f"x{known.key[1:]} [" in words]
    assert len(shown) == MOST_STRIPS
    assert {"x32", *(known.key for known in dictionary.channels if known.role == "control")} <= {
        *shown
    }


@pytest.mark.parametrize("c", range(len(CHANNELS)))
def test_a_strip_is_scaled_in_the_unit_of_its_label(c: int) -> None:
    samples = np.zeros(3, SAMPLE_LIKE)
    samples["t"] = range(3)
    strip = channel_strip(CHANNELS[c], c, StripChart(0.0, 2.0), 72.0, samples, TEN_DEGREES, 0.25)
    unit = {"rad": "deg", "rad/s": "deg/s", "g": "g"}[CHANNELS[c].unit]
    assert strip.label == f"{CHANNELS[c].symbol} [{unit}]"
    largest = 10.0 if unit != "g" else np.radians(10.0)
    assert (strip.low, strip.high) == pytest.approx((-1.12 * largest, 1.12 * largest))
    samples["y"] = samples["y_hat"] = np.radians(10.0) / 2
    level = strip.y(np.array([largest / 2]))[0]
    again = channel_strip(CHANNELS[c], c, StripChart(0.0, 2.0), 72.0, samples, TEN_DEGREES, 0.25)
    assert f"{level:.1f}" in "".join(again.svg([])).split('class="measured"')[1]


@pytest.mark.skipif(which("chromium") is None, reason="chromium is not installed")
def test_an_installed_program_draws_the_png(
    drawing: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = png(drawing)
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert int.from_bytes(content[16:20]) == 1360


def test_without_such_a_program_the_error_names_them(
    drawing: bytes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NoPngError, match="rsvg-convert, inkscape, chromium"):
        png(drawing)
