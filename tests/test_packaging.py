"""What `pip install .` takes along: the list in pyproject.toml is explicit, so it can forget."""

import tomllib

from tests.support.places import ROOT

SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


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
