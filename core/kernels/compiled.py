"""How the numerical kernels are compiled, and who is told while that happens."""

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
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys

KEPT_S = 24 * 3600.0
"""Compiled kernels that were used so recently stay [s]."""


@cache
def cache_directory(sources: Path = Path(__file__).parent) -> str:
    """Where compiled kernels are stored: another for any change in this folder, and for no other.

    numba itself looks at the one file a kernel stands in, not at the kernels which that one calls.
    """
    files = sorted(sources.rglob("*.py"))
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files))
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return str(Path(home) / "forewarn" / f"kernels-{digest.hexdigest()[:16]}")


@cache
def _own_cache() -> str:
    """The cache directory, noted as used now; those that no program uses any more are gone."""
    directory = Path(cache_directory())
    with suppress(OSError):  # a home that cannot be written: numba then finds another place
        directory.mkdir(parents=True, exist_ok=True)
        os.utime(directory)
        prune(directory)
    return str(directory)


def prune(directory: Path) -> None:
    """Remove the caches beside this one, but for the last used and all that were used in a day.

    A process that runs stores what it compiles: its folder may not go while it is at work.
    """
    others = [(other.stat().st_mtime, other) for other in directory.parent.glob("kernels-*")]
    unused = sorted(other for other in others if other[1] != directory)[:-1]
    for used, other in unused:
        if used < time.time() - KEPT_S:
            shutil.rmtree(other, ignore_errors=True)


def jit(function: Callable[..., Any]) -> Any:
    """Compile a kernel once a machine, without the GIL; IEEE arithmetic, so that bits repeat."""
    return _compiled(function, nogil=True)


def brief(function: Callable[..., Any]) -> Any:
    """Compile a kernel that takes microseconds: having the GIL back would take it longer."""
    return _compiled(function, nogil=False)


def entry(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """The compiled code for arguments of these very types, called without looking at them again.

    For a kernel that is called sample by sample; other types are not noticed: they give nonsense.
    """
    signature = tuple(map(numba.typeof, arguments))
    if signature not in kernel.overloads:
        kernel.compile(signature)
    return kernel.overloads[signature].entry_point


def _compiled(function: Callable[..., Any], nogil: bool) -> Any:
    settings: Any = config
    given = settings.CACHE_DIR
    settings.CACHE_DIR = given or _own_cache()
    try:
        kernel: Any = numba.njit(cache=True, nogil=nogil)(function)
    finally:
        settings.CACHE_DIR = given
    kernel._cache.load_overload = partial(_load, kernel._cache)
    name = f"{function.__module__}.{function.__qualname__}"
    kernel.compile = partial(_compile_once, kernel.compile, name)
    return kernel


def _load(cached: Any, signature: Any, target: Any) -> Any:
    """Load what was compiled earlier as numba does, but without what only compiling needs.

    numba imports all that it knows of Python and numpy, and with it scipy.linalg: 0.4 s.
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
    """Imports for compiled code the modules it is from: it names numba's own, and reads no name."""

    @staticmethod
    def import_module(name: str) -> ModuleType:
        if name.startswith("numba.") and name not in sys.modules:
            return ModuleType(name)
        return import_module(name)


def _compile_once(compile_: Callable[[Any], Any], name: str, signature: Any) -> Any:
    """Compile, or load what another process is compiling at this moment.

    numba's own lock comes first: a thread that holds it may ask for any kernel on its way.
    """
    with global_compiler_lock, ExitStack() as held:
        with suppress(OSError):  # where no lock can be written, each compiles for itself
            held.enter_context(FileLock(Path(_own_cache()) / f"{name}.lock"))
        return compile_(signature)


# Part of the kernel that calls: as a call it would take as long as what it does.
inlined = numba.njit(inline="always")


@cache
def threads() -> ThreadPoolExecutor:
    """The process's threads for kernels; a kernel never submits to it, so it cannot deadlock."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="kernel")


_here = threading.local()


@contextmanager
def on_this_thread() -> Iterator[None]:
    """Let kernels called inside the block stay on its thread: for work that is itself spread."""
    _here.alone = True
    try:
        yield
    finally:
        _here.alone = False


def in_chunks(n: int, size: int, task: Callable[[int, int], object]) -> None:
    """Run task(start, stop) over range(n) in pieces of `size`, on all threads; alone if one."""
    if n <= size or getattr(_here, "alone", False):
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
            self.say("compiling the numerical kernels: once on this machine, under a minute")

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def announce_compilation(say: Callable[[str], None]):
    """Call `say` once if any kernel has to be compiled inside the block; silent on a warm cache."""
    listener = _Compilation(say)
    with event.install_listener("numba:compile", listener):
        yield
