"""Compilation of the numerical kernels, its cache, and its announcement."""

import hashlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from filelock import FileLock
from numba.core import config, environment, event
from numba.core.caching import UserProvidedCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys

LOCATORS = f"{__name__}._ByContent,InTreeCacheLocator,UserWideCacheLocator"
"""Of compiled kernels; numba takes the first whose folder it can write to."""
KEEP_S = 24 * 3600.0
"""Caches used more recently are kept [s]."""


@cache
def cache_directory(sources: Path = Path(__file__).parent) -> str:
    """Cache directory of compiled kernels; it depends on the content of this folder, and on numba.

    Equal copies share it, such as one in a new environment. numba itself checks only the file of a
    kernel, not the kernels it calls.
    """
    files = sorted(sources.rglob("*.py"))
    content = b"".join(file.read_bytes() for file in files)
    digest = hashlib.sha256(numba.__version__.encode() + content)
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return str(Path(home) / "forewarn" / f"kernels-{digest.hexdigest()[:16]}")


@cache
def _own_cache() -> str:
    """The cache directory, marked as used now; unused ones are deleted."""
    directory = Path(cache_directory())
    with suppress(OSError):  # the home cannot be written: numba finds another place
        directory.mkdir(parents=True, exist_ok=True)
        os.utime(directory)
        prune(directory)
    return str(directory)


def prune(directory: Path) -> None:
    """Delete other caches, except the last used one and those used within KEEP_S.

    A running process stores kernels in its cache, so that must not be deleted.
    """
    others = [(other.stat().st_mtime, other) for other in directory.parent.glob("kernels-*")]
    unused = sorted(other for other in others if other[1] != directory)[:-1]
    for used, other in unused:
        if used < time.time() - KEEP_S:
            shutil.rmtree(other, ignore_errors=True)


def jit(function: Callable[..., Any]) -> Any:
    """Compile a kernel once per machine, without the GIL. IEEE arithmetic makes bits repeatable."""
    return _compiled(function, nogil=True)


def brief(function: Callable[..., Any]) -> Any:
    """Compile a kernel that takes microseconds; it keeps the GIL, because releasing costs more."""
    return _compiled(function, nogil=False)


def entry(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """Compiled code for arguments of exactly these types, called without type dispatch.

    For kernels called once per sample. Arguments of other types give wrong results without error.
    """
    signature = tuple(map(numba.typeof, arguments))
    if signature not in kernel.overloads:
        kernel.compile(signature)
    return kernel.overloads[signature].entry_point


class _ByContent(UserProvidedCacheLocator):
    """Keeps compiled kernels by the content of this folder, where numba would by its path."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        return Path(cache_directory()).name


def _compiled(function: Callable[..., Any], nogil: bool) -> Any:
    settings: Any = config
    given = settings.CACHE_DIR
    settings.CACHE_DIR = given or _own_cache()
    settings.CACHE_LOCATOR_CLASSES = LOCATORS
    try:
        kernel: Any = numba.njit(cache=True, nogil=nogil)(function)
    except RuntimeError as error:  # numba found no place that it can write to
        raise OSError(
            f"compiled kernels cannot be stored in {settings.CACHE_DIR}: set NUMBA_CACHE_DIR to a "
            "writable directory"
        ) from error
    finally:
        settings.CACHE_DIR, settings.CACHE_LOCATOR_CLASSES = given, ""
    kernel._cache.load_overload = partial(_load, kernel._cache)
    name = f"{function.__module__}.{function.__qualname__}"
    kernel.compile = partial(_compile_once, kernel.compile, name)
    return kernel


def _load(cached: Any, signature: Any, target: Any) -> Any:
    """Load cached code like numba, but without the imports that only compiling needs.

    numba would import everything it supports, including scipy.linalg: 0.4 s.
    """
    rtsys.initialize(target)
    modules: Any = environment
    given, modules.importlib = modules.importlib, _Loading
    try:
        with cached._guard_against_spurious_io_errors():
            return cached._load_overload(signature, target)
    finally:
        modules.importlib = given


class _Loading:
    """Imports the modules that cached code refers to, with empty stand-ins for numba's own."""

    @staticmethod
    def import_module(name: str) -> ModuleType:
        if name.startswith("numba.") and name not in sys.modules:
            return ModuleType(name)
        return import_module(name)


def _compile_once(compile_: Callable[[Any], Any], name: str, signature: Any) -> Any:
    """Compile, or load what another process is compiling now.

    numba's lock comes first, because a thread that holds it may request any kernel.
    """
    with global_compiler_lock, ExitStack() as locks:
        with suppress(OSError):  # without a lock file, each process compiles for itself
            locks.enter_context(FileLock(Path(_own_cache()) / f"{name}.lock"))
        return compile_(signature)


# Inlined into the calling kernel, because a call would take as long as the work.
inlined = numba.njit(inline="always")


@cache
def threads() -> ThreadPoolExecutor:
    """The process's threads for kernels; none waits for another, so they cannot deadlock."""
    return ThreadPoolExecutor(
        os.cpu_count() or 1, "kernel", initializer=lambda: setattr(_here, "alone", True)
    )


_here = threading.local()


@contextmanager
def on_this_thread() -> Iterator[None]:
    """Run kernels inside the block on its own thread, for work that is already parallel."""
    _here.alone = True
    try:
        yield
    finally:
        _here.alone = False


def is_alone() -> bool:
    """Whether this thread is one of many that already work in parallel."""
    return getattr(_here, "alone", False)


def in_chunks(n: int, size: int, task: Callable[[int, int], object]) -> None:
    """Run task(start, stop) over range(n) in pieces of `size`, on all threads."""
    if n <= size or is_alone():
        task(0, n)
        return
    starts = range(0, n, size)
    for job in [threads().submit(task, start, min(start + size, n)) for start in starts]:
        job.result()


class _Compilation(event.Listener):
    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say
        self.announced = False

    def on_start(self, event: event.Event) -> None:
        if not self.announced:
            self.announced = True
            self.say("compiling the numerical kernels (only at the first start)")

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def announce_compilation(say: Callable[[str], None]):
    """Call `say` once if a kernel is compiled inside the block; silent with a warm cache."""
    listener = _Compilation(say)
    with event.install_listener("numba:compile", listener):
        yield
