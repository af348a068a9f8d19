import ast
import shutil
from pathlib import Path

import pytest

import core
from core.kernels.compiled import cache_directory

CORE = Path(core.__file__).parent
KERNELS = CORE / "kernels"


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    return shutil.copytree(CORE, tmp_path / "core", ignore=shutil.ignore_patterns("__pycache__"))


def directory(sources: Path) -> str:
    cache_directory.cache_clear()
    return cache_directory(sources / "kernels")


def files(folder: Path) -> list[Path]:
    return sorted(file.relative_to(folder) for file in folder.rglob("*.py"))


@pytest.mark.parametrize("file", files(CORE), ids=str)
def test_only_an_edit_of_a_kernel_moves_the_compiled_kernels(sources: Path, file: Path) -> None:
    before = directory(sources)
    with (sources / file).open("a") as source:
        source.write("# edited\n")
    assert (directory(sources) != before) == (file.parts[0] == "kernels")


def test_the_compiled_kernels_lie_where_their_own_sources_say() -> None:
    cache_directory.cache_clear()
    assert cache_directory() == cache_directory(KERNELS)


@pytest.mark.parametrize("file", files(KERNELS), ids=str)
def test_a_kernel_takes_only_types_from_the_rest_of_the_core(file: Path) -> None:
    """A constant from elsewhere would be compiled in, and stay when it changes there."""
    for node in ast.walk(ast.parse((KERNELS / file).read_text())):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("core", "app")):
            assert f"{node.module}.".startswith(("core.kernels.", "core.types."))
        elif isinstance(node, ast.Import):
            assert not any(name.name.startswith(("core", "app")) for name in node.names)
