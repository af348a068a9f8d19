import asyncio
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
import websockets
from fastapi import WebSocket
from fastapi.exceptions import WebSocketException
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages
from viser.infra import Message, _infra
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from app.routes.scene import CONTENT_SECURITY_POLICY, same_origin
from app.scene import server as scene_server
from app.scene.server import (
    SECRET_HEADER,
    SUBPROTOCOL,
    SceneServerError,
    admitted,
    credentials,
    open_server,
)
from tests.support.scene_site import Site, show

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (-20, 5.5, -9.0),
    "fov": 0.75,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 400,
    "image_width": 640,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, -1.0),
}


def packed(message: Any) -> bytes:
    return msgspec.msgpack.encode(message)


@pytest.fixture
def arrivals(monkeypatch):
    """Messages that viser's server gets from watchers; `until(type)` waits for one."""

    class Arrivals(list[Message]):
        news = threading.Condition()

        def until(self, kind: type[Message]) -> list[type[Message]]:
            with self.news:
                came = self.news.wait_for(lambda: any(type(m) is kind for m in self), 20.0)
            assert came, f"no {kind.__name__} among {self}"
            return [type(message) for message in self]

    arrived = Arrivals()
    original = _infra.WebsockServer._handle_incoming_message

    async def noted(self, client_id, message):
        await original(self, client_id, message)
        with arrived.news:
            arrived.append(message)
            arrived.news.notify_all()

    monkeypatch.setattr(_infra.WebsockServer, "_handle_incoming_message", noted)
    return arrived


def watch(site: Site, flight: str = "f1", **options):
    """Connect to a scene as its own page does."""
    options = {"origin": site.http, "subprotocols": [SUBPROTOCOL], "max_size": None} | options
    return connect(f"{site.ws}/scene/{flight}", **options)


class TestTheLoopbackPort:
    def test_it_opens_to_this_process(self, scene):
        with connect(
            scene.address, additional_headers=credentials(), subprotocols=[SUBPROTOCOL]
        ) as watcher:
            assert len(watcher.recv()) > 16

    def test_it_is_on_loopback_only(self, scene):
        assert scene.address.startswith("ws://127.0.0.1:")
        assert scene._server.get_host() == "127.0.0.1"

    @pytest.mark.parametrize("headers", [{}, {SECRET_HEADER: ""}, {SECRET_HEADER: "guess"}])
    def test_it_stays_closed_without_the_secret(self, scene, headers):
        with pytest.raises(InvalidStatus) as refusal:
            connect(scene.address, additional_headers=headers, subprotocols=[SUBPROTOCOL])
        assert refusal.value.response.status_code == 403

    def test_it_stays_closed_to_another_process(self, scene):
        program = (
            "import sys; from websockets.sync.client import connect\n"
            f"try: connect(sys.argv[1], subprotocols=['{SUBPROTOCOL}'])\n"
            "except Exception as refusal: print(refusal.response.status_code)\n"
            "else: print('connected')"
        )
        said = subprocess.run(
            [sys.executable, "-c", program, scene.address], capture_output=True, text=True
        )
        assert said.stdout.strip() == "403"

    def test_it_serves_no_page(self, scene):
        with pytest.raises(urllib.error.HTTPError) as refusal:
            urllib.request.urlopen(scene.address.replace("ws", "http"))
        assert refusal.value.code == 403
        refusal.value.close()

    def test_a_server_that_lets_strangers_in_is_not_kept(self, monkeypatch):
        open_server().stop()
        monkeypatch.setattr(_infra, "websockets", websockets)
        before = threading.active_count()
        with pytest.raises(SceneServerError, match="answered 200"):
            open_server()
        assert threading.active_count() == before


class TestTheShareTunnel:
    @pytest.fixture
    def tunnels(self, monkeypatch):
        opened = []
        monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda self: opened.append(1))
        return opened

    def test_no_watcher_can_ask_for_it(self, site, arrivals, tunnels):
        scene = site.scenes.open("f1")
        with watch(site) as watcher:
            watcher.send(packed({"type": "ShareUrlRequest"}))
            watcher.send(packed(CAMERA))
            came = arrivals.until(_messages.ViewerCameraMessage)
        assert _messages.ShareUrlRequest not in came
        scene._server._thread_executor.shutdown(wait=True)
        assert tunnels == []

    def test_it_does_not_open_even_where_the_request_arrives(self, scene, arrivals, tunnels):
        with connect(
            scene.address, additional_headers=credentials(), subprotocols=[SUBPROTOCOL]
        ) as watcher:
            watcher.send(packed({"type": "ShareUrlRequest"}))
            arrivals.until(_messages.ShareUrlRequest)
        scene._server._thread_executor.shutdown(wait=True)
        assert tunnels == []

    def test_viser_would_have_opened_it(self, arrivals, tunnels):
        open_server().stop()  # puts the guard in place
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        with connect(
            scene_server.address(server),
            additional_headers=credentials(),
            subprotocols=[SUBPROTOCOL],
        ) as watcher:
            watcher.send(packed({"type": "ShareUrlRequest"}))
            arrivals.until(_messages.ShareUrlRequest)
        server._thread_executor.shutdown(wait=True)
        server.stop()
        assert len(tunnels) == 1


class TestWhatGoesUpstream:
    def test_a_camera_pose_passes(self):
        message = admitted(packed(CAMERA))
        assert message is not None
        assert isinstance(Message.deserialize(message), _messages.ViewerCameraMessage)

    @pytest.mark.parametrize("name", sorted(m.__name__ for m in _messages.Message.get_subclasses()))
    def test_of_visers_messages_only_the_camera_passes(self, name):
        for fields in ({}, {k: v for k, v in CAMERA.items() if k != "type"}):
            passes = admitted(packed({"type": name} | fields)) is not None
            assert passes == (name == "ViewerCameraMessage" and bool(fields))

    @pytest.mark.parametrize(
        "message",
        [
            b"",
            b"\xc1",
            b"\xd9\x02\xff\xff",
            packed(CAMERA)[:-3],
            packed(CAMERA | {"value": 1}),
            packed(CAMERA | {"fov": "wide"}),
            packed(CAMERA | {"position": (1.0, 2.0)}),
            packed(CAMERA | {"position": "x" * 20_000}),
            packed([CAMERA]),
        ],
    )
    def test_what_is_not_quite_a_camera_does_not(self, message):
        assert admitted(message) is None

    @given(st.binary(max_size=200))
    def test_noise_does_not(self, noise):
        assert admitted(noise) is None

    def test_a_watcher_cannot_write_the_words(self, site, arrivals):
        scene = site.scenes.open("f1")
        show(scene)
        scene.draw()
        headline = scene._picture._headline
        forged = {
            "type": "SceneNodeUpdateMessage",
            "name": headline.name,
            "updates": {"text": "RISK 0.00"},
        }
        with watch(site) as watcher:
            watcher.send(packed(forged))
            watcher.send(packed(CAMERA))
            came = arrivals.until(_messages.ViewerCameraMessage)
        assert came == [_messages.ViewerCameraMessage]
        assert headline.text == "RISK 0.04"

    def test_the_same_message_would_arrive_without_the_proxy(self, scene, arrivals):
        forged = {"type": "GuiUpdateMessage", "uuid": "x", "updates": {}}
        with connect(
            scene.address, additional_headers=credentials(), subprotocols=[SUBPROTOCOL]
        ) as watcher:
            watcher.send(packed(forged))
            assert _messages.GuiUpdateMessage in arrivals.until(_messages.GuiUpdateMessage)

    def test_text_frames_are_dropped(self, site, arrivals):
        site.scenes.open("f1")
        with watch(site) as watcher:
            watcher.send("ShareUrlRequest")
            watcher.send(packed(CAMERA))
            assert arrivals.until(_messages.ViewerCameraMessage) == [_messages.ViewerCameraMessage]


class TestTheRoutes:
    def get(self, url: str, **headers: str):
        return urllib.request.urlopen(urllib.request.Request(url, headers=headers))

    def test_the_page_is_visers_own_with_a_policy_and_an_etag(self, site):
        site.scenes.open("f1")
        with self.get(f"{site.http}/scene/f1/") as reply:
            html, headers = reply.read(), reply.headers
        assert b"</html>" in html
        assert len(html) > 500_000
        assert headers["Content-Security-Policy"] == CONTENT_SECURITY_POLICY
        assert headers["Content-Type"].startswith("text/html")
        with pytest.raises(urllib.error.HTTPError) as known:
            self.get(f"{site.http}/scene/f1/", **{"If-None-Match": headers["ETag"]})
        assert known.value.code == 304
        known.value.close()

    def test_the_policy_lets_the_page_talk_to_its_own_origin_only(self):
        rules = (rule.strip().partition(" ") for rule in CONTENT_SECURITY_POLICY.split(";"))
        policy = {name: sources for name, _, sources in rules}
        assert policy["default-src"] == "'none'"
        assert policy["connect-src"] == "'self' data: blob:"
        assert policy["frame-ancestors"] == "'self'"
        assert "http" not in CONTENT_SECURITY_POLICY
        assert "'unsafe-eval'" not in CONTENT_SECURITY_POLICY

    def test_a_flight_without_a_scene_has_no_page_and_no_stream(self, site):
        with pytest.raises(urllib.error.HTTPError) as missing:
            self.get(f"{site.http}/scene/nobody/")
        assert missing.value.code == 404
        missing.value.close()
        with pytest.raises(InvalidStatus):
            watch(site, "nobody")

    def test_a_watcher_sees_the_scene_through_the_server(self, site):
        site.scenes.open("f1")
        with watch(site) as watcher:
            assert watcher.subprotocol == SUBPROTOCOL
            assert len(watcher.recv()) > 16

    @pytest.mark.parametrize(
        "options",
        [
            {"origin": "https://elsewhere.example"},
            {"origin": "http://127.0.0.1:1"},
            {"origin": "null"},
            {"origin": None},
            {"subprotocols": None},
            {"subprotocols": ["viser-v0.0.1"]},
        ],
    )
    def test_another_site_or_another_client_is_refused(self, site, options):
        site.scenes.open("f1")
        with pytest.raises(InvalidStatus) as refusal:
            watch(site, **options)
        assert refusal.value.response.status_code == 403

    def test_the_origin_check_compares_with_the_host(self):
        headers = {"origin": "http://here:1", "host": "here:2"}
        handshake: Any = SimpleNamespace(headers=headers)
        with pytest.raises(WebSocketException):
            asyncio.run(same_origin(handshake))
        headers["host"] = "here:1"
        asyncio.run(same_origin(handshake))

    def test_a_closed_scene_sends_its_watchers_away(self, site):
        scene = site.scenes.open("f1")
        with watch(site) as watcher:
            watcher.recv()
            site.scenes.close("f1")
            assert all(map(bool, watcher))  # whatever was under way, then the end
        assert watcher.close_code == 1001
        assert site.scenes.get("f1") is None
        assert not scene.draw()

    def test_a_watcher_who_never_reads_holds_up_no_end(self, site, monkeypatch):
        full, stuck, gone = (threading.Event() for _ in range(3))
        send_bytes = WebSocket.send_bytes

        class Watchers(list):
            def remove(self, watcher):
                super().remove(watcher)
                gone.set()

        async def noted(self, message: bytes) -> None:
            if full.is_set():
                stuck.set()
            await send_bytes(self, message)
            if len(message) > 10_000_000:
                full.set()

        monkeypatch.setattr(WebSocket, "send_bytes", noted)
        scene = site.scenes.open("f1")
        scene._watchers = Watchers()
        with socket.create_connection(("127.0.0.1", site.port)) as watcher:
            watcher.sendall(
                f"GET /scene/f1 HTTP/1.1\r\nHost: x\r\nOrigin: http://x\r\nUpgrade: websocket\r\n"
                "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
                f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
            )
            assert b" 101 " in watcher.recv(100)
            cloud = np.zeros((4_000_000, 3), np.float32)  # more than all buffers on the way hold
            scene._server.scene.add_point_cloud("/cloud", cloud, (1, 2, 3), point_size=0.1)
            assert full.wait(20.0)
            show(scene)
            scene.draw()
            assert stuck.wait(20.0)
            assert not gone.is_set()
            site.scenes.close("f1")
            assert gone.wait(20.0)
