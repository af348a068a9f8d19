import ast
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

import core
from core.kernels.compiled import KEEP_S, cache_directory, jit, prune
from core.kernels.reductions import spread

CORE = Path(core.__file__).parent
KERNELS = CORE / "kernels"


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    return shutil.copytree(CORE, tmp_path / "core", ignore=shutil.ignore_patterns("__pycache__"))


def directory(sources: Path) -> str:
    cache_directory.cache_clear()
    return cache_directory(sources / "kernels")


COUNTED = """
import numpy as np
from core.kernels.reductions import spread
spread(np.zeros((2, 3)))
print(*spread.stats.cache_hits.values(), len(spread.stats.cache_misses))
"""


def test_an_equal_copy_elsewhere_compiles_nothing_anew(sources: Path) -> None:
    """Such as the next version, whose kernels are the same, in its own environment."""
    spread(np.zeros((2, 3)))
    assert directory(sources) == directory(CORE)
    call = [sys.executable, "-c", COUNTED]
    copy = subprocess.run(call, cwd=sources.parent, check=True, capture_output=True, text=True)
    assert copy.stdout.split() == ["1", "0"]


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


def test_the_present_kernels_the_last_used_others_and_those_of_today_are_kept(
    tmp_path: Path,
) -> None:
    days = {"present": 9, "last": 2, "older": 3, "oldest": 4}
    for name, ago in days.items():
        folder = tmp_path / f"kernels-{name}"
        (folder / "inner").mkdir(parents=True)
        used = time.time() - ago * KEEP_S
        os.utime(folder, (used, used))
    (tmp_path / "settings").mkdir()
    prune(tmp_path / "kernels-present")
    assert {path.name for path in tmp_path.iterdir()} == {
        "kernels-present",
        "kernels-last",
        "settings",
    }
    for name in ("used", "used-too"):
        (tmp_path / f"kernels-{name}").mkdir()
    prune(tmp_path / "kernels-present")
    assert {path.name for path in tmp_path.glob("*used*")} == {"kernels-used", "kernels-used-too"}
    assert not (tmp_path / "kernels-last").exists()


def test_a_home_that_cannot_be_written_stops_no_process(tmp_path: Path) -> None:
    (tmp_path / "forewarn").write_text("a file where the folder would be")
    import_kernels(tmp_path)


def import_kernels(cache_home: Path) -> None:
    """In a separate process."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache_home), "NUMBA_CACHE_DIR": ""}
    code = "import core.kernels.reductions"
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def test_a_process_notes_that_its_kernels_are_used(tmp_path: Path) -> None:
    folder = tmp_path / "forewarn" / Path(cache_directory()).name
    folder.mkdir(parents=True)
    os.utime(folder, (0, 0))
    import_kernels(tmp_path)
    assert folder.stat().st_mtime > time.time() - KEEP_S


@pytest.mark.parametrize("file", files(KERNELS), ids=str)
def test_a_kernel_takes_only_types_from_the_rest_of_the_core(file: Path) -> None:
    """A constant from elsewhere would be compiled in, and stay when it changes there."""
    for node in ast.walk(ast.parse((KERNELS / file).read_text())):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("core", "app")):
            assert f"{node.module}.".startswith(("core.kernels.", "core.types."))
        elif isinstance(node, ast.Import):
            assert not any(name.name.startswith(("core", "app")) for name in node.names)


def test_a_kernel_that_another_process_compiles_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.kernels.compiled._own_cache", lambda: str(tmp_path))

    def doubled(x: float) -> float:
        return 2 * x

    kernel = jit(doubled)
    with ThreadPoolExecutor(1) as thread:
        with FileLock(tmp_path / f"{__name__}.{doubled.__qualname__}.lock"):
            call = thread.submit(kernel, 1.5)
            assert not wait_for([call], timeout=0.3).done
        assert call.result(timeout=60) == 3.0


LATER = """
import sys
import numba
import numpy as np
from core.kernels.reductions import spread

points = np.random.default_rng(0).normal(size=(40, 3))
spread(points)
print("numba.np.arraymath" in sys.modules, "scipy.linalg" in sys.modules)

@numba.njit
def farthest(points):
    deviation, peak = spread(points)
    return np.sort(deviation)[0] + np.dot(peak, np.arange(3.0))

print(farthest(points) == farthest.py_func(points))
"""


def test_a_kernel_is_loaded_without_what_compiling_needs_and_others_are_compiled_then() -> None:
    spread(np.zeros((2, 3)))  # is in the cache from here on
    told = subprocess.run([sys.executable, "-c", LATER], check=True, capture_output=True, text=True)
    assert told.stdout.split() == ["False", "False", "True"]


def test_without_a_writable_cache_the_error_names_the_variable_to_set(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(**options: bool) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr("core.kernels.compiled.numba.njit", refuse)
    with pytest.raises(OSError, match="NUMBA_CACHE_DIR"):
        jit(len)
