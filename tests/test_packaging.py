"""What `pip install .` takes along: the list in pyproject.toml is explicit, so it can forget."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from functools import partial
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from tests.support.places import ROOT

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUPTOOLS = PYPROJECT["tool"]["setuptools"]
NEVER_IMPORTED = {
    "httptools": "uvicorn reads HTTP with it",
    "fastapi-offline": "its files are served, its code never runs",
}


def folders_of_code(top: str) -> set[str]:
    """Return the folders below `top` that hold Python files, as dotted names."""
    files = (ROOT / top).rglob("*.py")
    return {".".join(file.parent.relative_to(ROOT).parts) for file in files}


def test_every_folder_of_code_is_packaged():
    migrations = {f"app.{name}" for name in folders_of_code("alembic")}
    wanted = folders_of_code("app") | folders_of_code("core") | migrations | {"app.static"}
    assert set(SETUPTOOLS["packages"]) == wanted


def test_the_page_and_the_migrations_are_packaged_as_data():
    assert SETUPTOOLS["package-dir"] == {"app.alembic": "alembic", "app.static": "static"}
    assert SETUPTOOLS["package-data"]["app.static"] == ["**/*"]


def declared(*extras: str) -> set[str]:
    """Return the names of what is required, without an extra or with these."""
    project = PYPROJECT["project"]
    lists = (project["optional-dependencies"][extra] for extra in extras)
    required = [*project["dependencies"], *(name for names in lists for name in names)]
    return {re.split(r"[^\w.-]", requirement)[0] for requirement in required}


def imported() -> set[str]:
    """Return the distributions that the code imports from, anywhere in its files."""
    distributions, modules = packages_distributions(), set()
    for file in (file for top in ("app", "core") for file in (ROOT / top).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules.add(node.module.partition(".")[0])
    others = modules - sys.stdlib_module_names - {"app", "core"}
    return {distributions[module][0].lower().replace("_", "-") for module in others}


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    extras = "ulog", "mdf", "tdms", "mcap", "ch10", "fmu", "jsbsim", "dask", "mqtt", "archive"
    assert declared(*extras) - set(NEVER_IMPORTED) == imported()


@pytest.mark.parametrize(
    ("target", "installs"), [("demo", "--editable ."), ("test", "--editable '.[dev]'")]
)
def test_make_installs_what_a_target_needs_and_says_so(target: str, installs: str, tmp_path: Path):
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "Makefile").write_bytes((ROOT / "Makefile").read_bytes())
    # these tests may themselves be run by make, which then says more
    outside = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    run = partial(subprocess.run, ["make", "-n", target], cwd=tmp_path, env=outside, check=True)
    lines = run(stdout=subprocess.PIPE).stdout.decode().splitlines()
    (pip,) = (line for line in lines if "pip install" in line)
    assert pip.endswith(installs)
    assert lines[0].startswith("echo ")
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / ".ready").touch()
    assert b"pip" not in run(stdout=subprocess.PIPE).stdout
