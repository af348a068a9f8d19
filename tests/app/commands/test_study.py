"""`forewarn study`: its files, repeated for a seed, and nothing where it is interrupted."""

import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from app.cli import main
from app.recipes.recipes import limits_named, to_plain
from core.planned_test.planned_test import DatasetRecipe

FIRST_PNG_BYTES = b"\x89PNG\r\n\x1a\n"
LEAST = ("--n-monitors", "1", "--n-test", "20")
FIGURES = "app.report.studies.study_figures.render"


def small_study(out: Path, *more: str) -> list[str]:
    return ["study", "--n-monitors", "2", "--n-test", "100", "-o", str(out), *more]


def contents(directory: Path) -> dict[str, bytes]:
    """Read each file of a directory, by name."""
    return {path.name: path.read_bytes() for path in directory.iterdir()}


@pytest.fixture(scope="module")
def small_studied(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], str]:
    """Run a small study once: its files, and what was printed."""
    out, printed = tmp_path_factory.mktemp("study") / "out", StringIO()
    with redirect_stdout(printed):
        assert main(small_study(out, "--seed", "3")) == 0
    return contents(out), printed.getvalue()


def test_study_writes_table_data_and_figures(small_studied: tuple[dict[str, bytes], str]):
    files, printed = small_studied
    assert sorted(files) == [
        "miss_and_power.png",
        "miss_and_power.svg",
        "safe_flight.svg",
        "study.json",
        "unsafe_flight.svg",
    ]
    assert files["miss_and_power.png"].startswith(FIRST_PNG_BYTES)
    assert b"last timely alert" in files["unsafe_flight.svg"]
    assert b"last timely alert" not in files["safe_flight.svg"]
    assert b"<svg" in files["miss_and_power.svg"]
    study = json.loads(files["study.json"])
    for method in study["methods"].values():
        for (low, high), power in zip(method["power_interval"], method["power"], strict=True):
            assert low <= power <= high
    lines = [line for line in printed.splitlines() if line.startswith(tuple(study["methods"]))]
    names = [line[:27].strip() for line in lines]
    assert names == [*study["ranking"], *study["others"]]
    for line, assumption in zip(lines[-4:], study["others"].values(), strict=True):
        assert assumption in line


def test_study_repeats_to_the_byte_for_a_seed(small_studied, tmp_path: Path):
    assert main(small_study(tmp_path / "again", "--seed", "3")) == 0
    assert contents(tmp_path / "again") == small_studied[0]


@pytest.mark.parametrize(
    "moment", ["core.evaluation.study.evaluate", "app.report.studies.study_figures.study_curves"]
)
def test_interrupted_study_leaves_nothing_behind(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(FIGURES, lambda _, stem: {f"{stem}.svg": b""})
    monkeypatch.setattr(moment, interrupt)
    assert main(small_study(tmp_path / "out", *LEAST)) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_study_into_a_file_is_refused_before_the_work(tmp_path: Path, monkeypatch, capsys):
    (tmp_path / "taken").write_text("mine")
    monkeypatch.setattr("app.commands.study.study", lambda *_, **__: pytest.fail("it ran"))
    assert main(["study", "-o", str(tmp_path / "taken" / "out")]) == 1
    assert "taken is a file: give a directory" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


def test_the_study_is_without_imperfections_unless_they_are_asked_for(capsys):
    for options, expected in (
        ([], DatasetRecipe()),
        (["--imperfections", "usual"], DatasetRecipe().as_trained()),
    ):
        assert main(["study", *options, "--print-recipe"]) == 0
        assert json.loads(capsys.readouterr().out)["dataset"] == limits_named(to_plain(expected))
