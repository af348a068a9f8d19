"""Run work in threads to its end, with a few threads for work that needs a whole core."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


class Busy(RuntimeError):
    """The maximum of work is in progress."""


class Workers:
    """n threads for seconds of work each, with a queue of limited length."""

    def __init__(self, n: int = 2, queue: int = 16) -> None:
        self.limit = n + queue
        self.n_under_way = 0
        self._pool = ThreadPoolExecutor(n, "recordings")

    async def run(self, call: Callable[..., Result], *arguments: object) -> Result:
        """Run in a thread when one is free. Busy."""
        if self.n_under_way >= self.limit:
            raise Busy(
                f"{self.n_under_way} files are in progress, the maximum: try again when one is "
                "finished"
            )
        self.n_under_way += 1
        try:
            return await run_to_end(call, *arguments, pool=self._pool)
        finally:
            self.n_under_way -= 1

    def close(self) -> None:
        """Finish started work; queued work is dropped."""
        self._pool.shutdown(cancel_futures=True)


async def run_to_end(
    call: Callable[..., Result], *arguments: object, pool: ThreadPoolExecutor | None = None
) -> Result:
    """Run in a thread; a cancelled caller still waits for the end of the call.

    A thread cannot be stopped, and its files must not be removed while it works.
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
