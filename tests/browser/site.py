"""The whole program behind a real port, in a thread: its data directory outlives a restart."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.main import create_app
from app.serving import Server, listen
from app.settings import Settings
from app.store.store import Store


class Site:
    """A server that can be stopped and started again at the same address."""

    def __init__(self, data_dir: Path, **settings: Any) -> None:
        self._listening = listen(Settings(data_dir=data_dir, port=0, **settings))
        self.port = self._listening.getsockname()[1]
        self.settings = Settings(data_dir=data_dir, port=self.port, **settings)
        self._start()

    @property
    def http(self) -> str:
        """Its origin."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def store(self) -> Store:
        """Its store."""
        return self._server.app.state.store

    def close_scene(self, flight: str) -> None:
        """Close the scene of a flight that goes on."""
        self._server.app.state.scenes.close(flight)

    def _start(self) -> None:
        started = threading.Event()

        async def opened(_: Any) -> None:
            started.set()

        self._server = Server(create_app(self.settings), opened)
        sockets = [self._listening]
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._server.serve(sockets=sockets)), daemon=True
        )
        self._thread.start()
        assert started.wait(60)

    def stop(self) -> None:
        """End the server and its flights as a signal would."""
        self._server.should_exit = True
        self._thread.join(30)
        assert not self._thread.is_alive()
        self._listening.close()

    def start_again(self) -> None:
        """Serve the same data at the same address."""
        self._listening = listen(self.settings)
        self._start()


@contextmanager
def open_site(data_dir: Path, **settings: Any) -> Iterator[Site]:
    """A site that has stopped when the block ends."""
    site = Site(data_dir, **settings)
    try:
        yield site
    finally:
        if site._thread.is_alive():
            site.stop()
