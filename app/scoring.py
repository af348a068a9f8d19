"""Scoring a recorded flight: report, figure and table of assessments."""

import csv
import io
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app import figures
from app.recipes import from_plain
from app.telemetry.csv_reader import read
from app.telemetry.recording import Recording, subtract_trim
from app.telemetry.resampling import resample
from app.verdict import outside_training, verdict
from core.channels import CHANNELS
from core.monitor import Assessments, Monitor, load
from core.monitor.assessment import STATES
from core.specification import Limits
from core.whole_file import write_whole

Array = npt.NDArray[np.float64]


def score_file(
    monitor_file: Path, file: Path, epsilon: float | None, trim: float | None, out: Path
) -> tuple[str, bool]:
    """Score a recording, write assessments.csv and the figure into `out`.

    trim: seconds at the start whose mean is subtracted, None to leave the channels as they are.
    Returns the report and whether any sample could be assessed.
    """
    monitor = load(monitor_file)
    epsilon = monitor.check_epsilon(epsilon)
    limits = _specification(monitor)
    recording = read(file)
    if trim is not None:
        recording = subtract_trim(recording, trim)
    fine, recording = recording, resample(recording, monitor.dt)
    said = monitor.assess(recording.t, recording.y, epsilon)
    title = f"{file.name} scored by {monitor_file.name}"
    outside = outside_training(monitor, recording.y, said.y_hat)
    figure = figures.scored_recording(
        monitor, recording.y, said, limits.magnitudes, epsilon, title, outside
    )
    files = {"assessments.csv": _table(recording, said)} | figures.render(figure, "scored")
    out.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_whole(out / name, content)
    report = [
        *recording.notes,
        *verdict(monitor, limits, fine, said, epsilon),
        f"written: {', '.join(str(out / name) for name in files)}",
    ]
    return "\n".join(report), bool(np.isfinite(said.p_value).any())


def _specification(monitor: Monitor) -> Limits:
    """Limits the monitor was trained for; the default ones where it does not say."""
    return from_plain(Limits(), monitor.dataset_recipe.get("specification", {}), "specification")


def _table(recording: Recording, said: Assessments) -> bytes:
    """CSV with channel names and units as `score` reads them, and the assessments beside."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    units = {"rad": "rad", "rad/s": "radps", "g": "g"}
    names = [f"{channel.key}_{units[channel.unit]}" for channel in CHANNELS]
    head = ["t_s", *names, "state", "p_value", "alert", "score"]
    writer.writerow([*head, *(f"predicted_{name}" for name in names)])
    for i in range(len(said)):
        state = STATES[said.state[i]]
        alert = "" if np.isnan(said.p_value[i]) else int(said.alert[i])
        writer.writerow(
            [
                *_cells(recording.t[i], *recording.y[i]),
                state,
                *_cells(said.p_value[i]),
                alert,
                *_cells(said.score[i], *said.y_hat[i]),
            ]
        )
    return text.getvalue().encode()


def _cells(*numbers: float) -> list[str]:
    return ["" if np.isnan(number) else repr(float(number)) for number in numbers]
