"""The study's figure of two flights reads in degrees, deg/s and g."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from app.report.studies.study_figures import draw_flight, render
from core.channels import CHANNELS
from core.dataset import Dataset
from core.limits.limits import Envelope
from core.monitor import MonitorRecipe, train


def test_outputs_forecasts_and_limits_are_in_display_units(dataset: Dataset) -> None:
    monitor = train(dataset, MonitorRecipe())
    y = dataset.safe[0]
    assessments = monitor.assess(dataset.dt * np.arange(len(y)), y)
    strips = Figure().subplots(len(CHANNELS) + 1, 1)
    draw_flight(strips, monitor, y, assessments, Envelope.of_magnitudes(np.full(6, 0.5)), 0.1)
    for c, (strip, channel) in enumerate(zip(strips, CHANNELS, strict=False)):
        measured, forecast, above, below = (np.asarray(line.get_ydata()) for line in strip.lines)
        factor = 1.0 if channel.key == "Ny" else np.degrees(1.0)
        assert measured == pytest.approx(factor * y[:, c])
        assert forecast == pytest.approx(factor * assessments.y_hat[:, c], nan_ok=True)
        assert (above[0], below[0]) == pytest.approx((0.5 * factor, -0.5 * factor))
        assert f"[{channel.display_unit}]" in strip.get_ylabel()


def test_a_missing_font_prints_nothing(caplog: pytest.LogCaptureFixture) -> None:
    figure = Figure()
    figure.text(0.5, 0.5, "text", family="a font that is nowhere")
    assert render(figure, "figure")["figure.svg"]
    assert caplog.records == []
