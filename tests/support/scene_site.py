"""A tiny server with scenes and nothing else, and a scripted flight to show on one."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import radians

import uvicorn
from fastapi import FastAPI
from fastapi.responses import HTMLResponse

from app.routes.scene import scene_router
from app.scene.scene import Scene, Scenes
from app.scene.shown import Shown
from core.monitor.assessment import State
from core.monitor.status import Facts
from core.simulation.attitude import Attitude

NEVER = 1e9
FRAME = """<link rel="icon" href="data:,"><body style="margin:0">
<iframe id="scene" src="/scene/{flight}/" width="640" height="400">"""


@dataclass(frozen=True)
class Site:
    """Where the server listens, and its scenes."""

    scenes: Scenes
    port: int

    @property
    def http(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def ws(self) -> str:
        return f"ws://127.0.0.1:{self.port}"


@contextmanager
def scene_site(stale_after_s: float = NEVER) -> Iterator[Site]:
    """Serve in a thread; on leaving, every scene and the server have ended, or it raises."""
    app = FastAPI()
    app.state.scenes = Scenes(stale_after_s=stale_after_s)
    app.include_router(scene_router())

    @app.get("/frame/{flight}")
    def frame(flight: str) -> HTMLResponse:
        return HTMLResponse(FRAME.format(flight=flight))

    listener = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=3)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        yield Site(app.state.scenes, listener.getsockname()[1])
    finally:
        app.state.scenes.stop()
        server.should_exit = True
        thread.join(20.0)
        listener.close()
        assert not thread.is_alive()


def show(scene: Scene, t: float = 1.0, **changes) -> None:
    """Show a calm moment of a doublet, with changes."""
    calm = {
        "t": t,
        "attitude": Attitude(radians(12.0), radians(3.0), radians(8.0)),
        "beta": radians(1.5),
        "delta_a": radians(2.0),
        "delta_r": radians(-4.0),
        "p_value": 0.04,
        "alert_above": 0.1,
        "alert": False,
        "state": State.OK,
        "reason": "",
    }
    shown = Shown(**{"facts": Facts(), **calm, **changes})
    state = shown.state
    of_sample = Facts(
        alert=shown.alert,
        stale=state is State.STALE,
        invalid=state is State.INVALID,
        warming_up=state is State.WARMING_UP,
    )
    scene.show(shown if "facts" in changes else shown._replace(facts=of_sample))
