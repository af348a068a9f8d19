"""Health of the store: checked on request, and every CHECK_S while needed."""

import asyncio
from collections.abc import Callable

from app.store.store import Store

ANSWER_S = 2.0
"""A store that takes longer to answer is not ready [s]."""
CHECK_S = 5.0


class StoreHealth:
    """Whether the store works, as of the newest check.

    fault: one sentence; empty if the store works.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._check: asyncio.Future[str] | None = None
        self.fault = ""

    async def check(self) -> str:
        """Check now and return the fault; a store that hangs is checked only once."""
        if self._check is None or self._check.done():
            self._check = asyncio.ensure_future(asyncio.to_thread(_fault_of, self._store))
        try:
            self.fault = await asyncio.wait_for(asyncio.shield(self._check), ANSWER_S)
        except TimeoutError:
            self.fault = f"the store has not answered for {ANSWER_S:g} s: check its disk"
        return self.fault

    async def repeat(self, is_needed: Callable[[], bool]) -> None:
        """Check every CHECK_S while `is_needed()` or after a write; never returns."""
        while True:
            await asyncio.sleep(CHECK_S)
            if is_needed() or self._store.has_written:
                await self.check()


def _fault_of(store: Store) -> str:
    try:
        store.jobs.all()
    except Exception:
        return "the store cannot be read: see the log for the reason"
    try:
        store.touch()
    except Exception:
        return "the store cannot be written: check that its disk has space and allows writing"
    return ""
