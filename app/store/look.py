"""Whether the store works at present: looked at when asked, and each LOOK_S while it is needed."""

import asyncio
from collections.abc import Callable

from app.store.store import Store

ANSWER_S = 2.0
"""A store that takes longer to answer is not ready."""
LOOK_S = 5.0


class StoreLook:
    """What is wrong with a store, by the newest look at it.

    fault: one sentence, empty where nothing is.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._under_way: asyncio.Future[str] | None = None
        self.fault = ""

    async def look(self) -> str:
        """Look now and return the fault; a store that hangs is asked once."""
        if self._under_way is None or self._under_way.done():
            self._under_way = asyncio.ensure_future(asyncio.to_thread(_fault_of, self._store))
        try:
            self.fault = await asyncio.wait_for(asyncio.shield(self._under_way), ANSWER_S)
        except TimeoutError:
            self.fault = f"the store has not answered for {ANSWER_S:g} s: see what holds its disk"
        return self.fault

    async def repeat(self, is_needed: Callable[[], bool]) -> None:
        """Look each LOOK_S while it is needed; never returns."""
        while True:
            await asyncio.sleep(LOOK_S)
            if is_needed():
                await self.look()


def _fault_of(store: Store) -> str:
    try:
        store.jobs.all()
    except Exception:
        return "the store cannot be read; the log says why"
    try:
        store.touch()
    except Exception:
        return "the store cannot be written: see that its disk has space and allows writing"
    return ""
