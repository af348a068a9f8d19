"""The scene of a flight: viser's client page, and its WebSocket through this server's port.

The page derives its WebSocket from its own address: served at /scene/{flight}/, it connects to
/scene/{flight}. All messages pass down to the page; only a watcher's camera passes up.
"""

import asyncio
import hashlib
import json
from collections.abc import Coroutine
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import viser
from fastapi import APIRouter, Depends, Header, HTTPException, Request, Response, WebSocket
from fastapi.exceptions import WebSocketException
from starlette.requests import HTTPConnection
from starlette.status import WS_1001_GOING_AWAY, WS_1008_POLICY_VIOLATION
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from app.scene.picture import CAMERAS, STATE, WORDS
from app.scene.scene import Scene, Scenes
from app.scene.server import SUBPROTOCOL, admitted, credentials

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
    "connect-src 'self' data: blob:; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)
"""Only what viser's client needs; it connects to this origin alone."""

STYLE = b"""<style>#webgl-software-rendering, .mantine-Paper-root, .mantine-Notifications-root
{display:none !important}
html, canvas[data-engine] {background: #16283c}
html[data-theme="light"], [data-theme="light"] canvas[data-engine] {background: #b4d2ee}
</style>"""
"""Hides the client's panel and notices, which would cover the aircraft. The canvas is
transparent above the horizon: its background is the sky, in the theme that the Fly page sets."""

SCRIPT = (
    """<script>
globalThis.Function = new Proxy(Function, {apply: () => () => () => {}, construct: () => () => {}});
{
  const cameras = CAMERAS, search = new URLSearchParams(location.search);
  let link = null, shown = "all";
  const get = (...messages) => link?.onmessage({data: {type: "message_batch", messages}});
  const setWords = () => get(...[["WORDS", shown !== "none"], ["STATE", shown === "all"]].map(
    ([name, visible]) => ({type: "SetSceneNodeVisibilityMessage", name, visible})));
  globalThis.Worker = class extends Worker {
    postMessage(message, ...more) {
      if (message?.type === "set_server") {
        link = this;
        this.addEventListener("message", ({data}) => {
          if (data.messages?.some(({name}) => name === "STATE")) setTimeout(setWords);
        });
      }
      super.postMessage(message, ...more);
    }
  };
  globalThis.lookFrom = (name) => {
    const {position, look_at} = cameras[name];
    get({type: "SetCameraLookAtMessage", look_at}, {type: "SetCameraPositionMessage", position});
  };
  globalThis.showWords = (which) => {
    shown = which;
    setWords();
  };
  const first = cameras[search.get("camera")];
  if (first && !search.has("initialCameraPosition")) {
    search.set("initialCameraPosition", first.position.join());
    search.set("initialCameraLookAt", first.look_at.join());
    history.replaceState(null, "", `?${search}`);
  }
}
</script>""".replace("WORDS", WORDS)
    .replace("STATE", STATE)
    .replace("CAMERAS", json.dumps({key: at._asdict() for key, at in CAMERAS.items()}))
)
"""Replaces Function, which the policy forbids: the client's sorter of splats calls it while it
loads, and would log an error, although no scene has splats. ?camera=tail is the first view, and
lookFrom(name) another one, and showWords("all" | "numbers" | "none") chooses the texts: the client
gets these as if the server had sent them."""


@dataclass(frozen=True)
class ClientPage:
    """The client's single HTML file, as installed."""

    html: bytes
    etag: str


@cache
def client_page() -> ClientPage:
    """Read the page from the installed viser package once; add STYLE and SCRIPT."""
    html = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    html = html.replace(b"<head>", b"<head>" + SCRIPT.encode(), 1)
    html = html.replace(b"</head>", STYLE + b"</head>", 1)
    return ClientPage(html, f'"{hashlib.sha256(html).hexdigest()[:32]}"')


async def same_origin(websocket: WebSocket) -> None:
    """Refuse a WebSocket from a page of another site; every browser sends an Origin."""
    origin = urlsplit(websocket.headers.get("origin", ""))
    if origin.scheme not in ("http", "https") or origin.netloc != websocket.headers.get("host"):
        raise WebSocketException(WS_1008_POLICY_VIOLATION, "the request comes from another site")


def _scene(connection: HTTPConnection, flight: str) -> Scene | None:
    scenes: Scenes = connection.app.state.scenes
    return scenes.get(flight)


def scene_router() -> APIRouter:
    """Routes /scene/{flight}/ (page) and /scene/{flight} (WebSocket); need app.state.scenes."""
    router = APIRouter(include_in_schema=False)

    @router.get("/scene/{flight}/")
    async def page(
        request: Request, flight: str, if_none_match: Annotated[str, Header()] = ""
    ) -> Response:
        if _scene(request, flight) is None:
            raise HTTPException(404, f"flight {flight} has no scene: it ended, or never had one")
        client = client_page()
        headers = {
            "ETag": client.etag,
            "Cache-Control": "private, no-cache",
            "Content-Security-Policy": CONTENT_SECURITY_POLICY,
            "X-Content-Type-Options": "nosniff",
        }
        if client.etag in if_none_match:
            return Response(status_code=304, headers=headers)
        return Response(client.html, media_type="text/html", headers=headers)

    @router.websocket("/scene/{flight}", dependencies=[Depends(same_origin)])
    async def stream(websocket: WebSocket, flight: str) -> None:
        if SUBPROTOCOL not in websocket.scope["subprotocols"]:
            raise WebSocketException(
                WS_1008_POLICY_VIOLATION, f"the scene needs {SUBPROTOCOL}: reload the page"
            )
        scene = _scene(websocket, flight)
        if scene is None:
            raise WebSocketException(WS_1008_POLICY_VIOLATION, "this flight has no scene")
        await _proxy(websocket, scene)

    return router


async def _proxy(websocket: WebSocket, scene: Scene) -> None:
    """Pass messages both ways until either side or the scene ends, then drop the upstream."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    with scene.watching(partial(loop.call_soon_threadsafe, ended.set)):
        upstream = await connect(
            scene.address,
            additional_headers=credentials(),
            subprotocols=[SUBPROTOCOL],
            compression=None,
            max_size=None,
            max_queue=4,
            ping_interval=None,
            proxy=None,
        )
        try:
            await websocket.accept(SUBPROTOCOL)
            await _first_of(_down(upstream, websocket), _up(websocket, upstream), ended.wait())
            await _close(websocket)
        finally:
            upstream.transport.abort()


async def _first_of(*pumps: Coroutine[Any, Any, Any]) -> None:
    """Run all until one ends, then cancel the others, even if they are blocked."""
    tasks = [asyncio.ensure_future(pump) for pump in pumps]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _down(upstream: ClientConnection, websocket: WebSocket) -> None:
    try:
        async for message in upstream:
            await websocket.send_bytes(message)  # pyright: ignore[reportArgumentType]
    except (ConnectionClosed, WebSocketDisconnect):
        pass


async def _up(websocket: WebSocket, upstream: ClientConnection) -> None:
    try:
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            camera = admitted(message.get("bytes") or b"")
            if camera is not None:
                await upstream.send(camera)
    except ConnectionClosed:
        pass


async def _close(websocket: WebSocket) -> None:
    """Close the watcher's connection; do not wait long for a watcher that does not respond."""
    try:
        async with asyncio.timeout(1.0):
            await websocket.close(WS_1001_GOING_AWAY)
    except (TimeoutError, RuntimeError, WebSocketDisconnect):
        pass
