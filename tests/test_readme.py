import re

import pytest

from tests.support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_fits_on_one_screen():
    lines = README.splitlines()
    assert len(lines) <= 120
    assert max(map(len, lines)) <= 120


def test_links_and_pictures_of_the_readme_exist():
    for target in re.findall(r'(?:\]\(|src(?:set)?=")([^)"]+)', README):
        assert (ROOT / target).is_file(), target


def test_python_of_the_readme_runs(capsys: pytest.CaptureFixture):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    assert "True" in capsys.readouterr().out


def test_make_targets_of_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    lines = re.findall(r"^    make (.*?)(?:#|$)", README, re.MULTILINE)
    assert len(lines) == 2
    for target in " ".join(lines).split():
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
