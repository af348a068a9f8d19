"""Work in threads that is waited for to its end; a few threads for what takes all of a core."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


class Busy(RuntimeError):
    """As much is under way as may be."""


class Workers:
    """n threads for seconds of work each, and a queue before them, which may be so long."""

    def __init__(self, n: int = 2, queue: int = 16) -> None:
        self.limit = n + queue
        self.n_under_way = 0
        self._pool = ThreadPoolExecutor(n, "recordings")

    async def run(self, call: Callable[..., Result], *arguments: object) -> Result:
        """Run in one of the threads when it is free. Busy."""
        if self.n_under_way >= self.limit:
            raise Busy(
                f"{self.n_under_way} files are being worked on, as many as may be: try again "
                "when one of them is done"
            )
        self.n_under_way += 1
        try:
            return await to_its_end(call, *arguments, pool=self._pool)
        finally:
            self.n_under_way -= 1

    def close(self) -> None:
        """Wait for what has begun; the rest never does."""
        self._pool.shutdown(cancel_futures=True)


async def to_its_end(
    call: Callable[..., Result], *arguments: object, pool: ThreadPoolExecutor | None = None
) -> Result:
    """Run in a thread; a cancelled caller waits for the end of the call all the same.

    A thread cannot be stopped, and the files it works on must not be taken from under it.
    """
    work = asyncio.get_running_loop().run_in_executor(pool, call, *arguments)
    try:
        return await asyncio.shield(work)
    except asyncio.CancelledError:
        if not work.done():
            await asyncio.wait([work])
        if not work.cancelled():
            work.exception()
        raise
