import re
import shlex
from pathlib import Path

import pytest

from app.cli import main
from tests.support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SMALL = {
    "study": ["--n-monitors", "2", "--n-test", "50"],
    "train": ["--n-test", "200"],
    "report": ["--n-test", "200"],
}


def test_commands_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    commands = re.findall(
        r"^ {4,6}forewarn ((?:study|train|sample-flight|score|report) .*)$", README, re.MULTILINE
    )
    assert len(commands) == 7
    for command in commands:
        arguments = shlex.split(command)
        assert main([*arguments, *SMALL.get(arguments[0], [])]) == 0, command
    assert (tmp_path / "flight-scored" / "scored.svg").exists()
    assert (tmp_path / "flight-report.html").exists()


def test_python_of_the_readme_runs(tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    assert "risk" in capsys.readouterr().out


def test_make_targets_of_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in re.findall(r"^    make (.*?)(?:#|$)", README, re.MULTILINE):
        for target in line.split():
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
