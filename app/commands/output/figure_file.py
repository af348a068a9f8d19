"""A figure that a command writes where it is asked to."""

from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.options.destinations import check_file
from core.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # a quarter of a second


def check_figure(path: Path | None) -> None:
    """Refuse a place that cannot be written, or that is named for no known format; ValueError."""
    if path is None:
        return
    check_file(path)
    if path.suffix not in (".png", ".svg"):
        raise ValueError(f"{path} was given: a figure's name ends in .png or .svg")


def write_figure(path: Path, figure: "Figure") -> None:
    """Draw it in the format that the file is named for."""
    from app.report.studies.study_figures import render  # matplotlib

    kind = path.suffix[1:]
    write_whole(path, render(figure, "figure", [kind])[f"figure.{kind}"])
