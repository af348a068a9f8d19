"""A Dask cluster as the executor of long computations."""

import platform
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from core import __version__
from core.monitor import train
from core.planned_test.collection import DatasetRecipe, collect

if TYPE_CHECKING:
    from distributed import Client

ANSWERS_S = 10
"""[s] A scheduler that takes longer to answer is not there."""
SAME_BITS = ("numpy", "scipy", "numba")
"""Packages whose version may change the bits of a result."""


class ClusterError(ValueError):
    """A cluster that cannot compute. The message gives the cause and what to do."""


@contextmanager
def executor_at(scheduler: str | None) -> Iterator[Executor | None]:
    """The executor of a cluster, or None, which is this machine, without a scheduler.

    scheduler: address such as tcp://host:8786.   ClusterError.
    """
    if not scheduler:
        yield None
        return
    with _connected(scheduler) as client:
        check(client, scheduler)
        warm = [client.submit(warm_up, workers=[each], pure=False) for each in _workers(client)]
        client.gather(warm)
        yield client.get_executor(pure=False)


def words_of(scheduler: str) -> str:
    """The workers of a cluster. ClusterError if it cannot compute."""
    with _connected(scheduler) as client:
        return check(client, scheduler)


def check(client: "Client", scheduler: str) -> str:
    """Compare the versions of all workers with ours; return how many there are. ClusterError."""
    workers = _workers(client)
    if not workers:
        raise ClusterError(
            f"the scheduler {scheduler} has no worker: start one with "
            f"`dask worker {scheduler} --nthreads 1`"
        )
    try:
        theirs: Any = client.run(versions)
    except ImportError as error:
        raise ClusterError(f"a worker has no forewarn ({error}): install it there") from None
    ours = versions()
    for worker, those in theirs.items():
        for package, installed in those.items():
            if installed != ours[package]:
                raise ClusterError(
                    f"worker {worker} has {package} {installed}, this machine {ours[package]}: "
                    "results would differ, install the same version"
                )
    return f"{len(workers)} workers at {scheduler}, with the same versions as here"


def versions() -> dict[str, str]:
    """Versions that determine the bits of a result."""
    own = {"forewarn": __version__, "Python": platform.python_version()}
    return own | {package: version(package) for package in SAME_BITS}


def warm_up() -> None:
    """Compile or load the kernels that nearly all work needs."""
    train(collect(replace(DatasetRecipe(), n_unsafe=12)))


def _workers(client: "Client") -> list[str]:
    known: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    return [*known]


def _connected(scheduler: str) -> "Client":
    try:
        from distributed import Client  # an extra, and slow to import
    except ImportError:
        raise ClusterError(
            "a cluster needs Dask: install forewarn[dask], or leave the scheduler out"
        ) from None
    try:
        return Client(scheduler, timeout=ANSWERS_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`, "
            "or leave it out to compute on this machine"
        ) from None
