"""The study's figures."""

import pytest
from matplotlib.figure import Figure

from app.report.studies.study_figures import render


def test_a_missing_font_prints_nothing(caplog: pytest.LogCaptureFixture) -> None:
    figure = Figure()
    figure.text(0.5, 0.5, "text", family="a font that is nowhere")
    assert render(figure, "figure")["figure.svg"]
    assert caplog.records == []
