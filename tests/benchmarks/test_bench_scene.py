"""What a scene costs: showing, drawing, opening, and watchers through the proxy; figures only."""

import os
import time
import tracemalloc

import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

from app.scene.scene import Scenes
from app.scene.server import SUBPROTOCOL
from core.simulation.attitude import Attitude
from tests.support.scene_site import scene_site, show

pytestmark = pytest.mark.benchmark
N_WATCHERS = 5


def per_call(function, n: int) -> float:
    """Mean time of a call [us]."""
    begun = time.perf_counter()
    for k in range(n):
        function(k)
    return 1e6 * (time.perf_counter() - begun) / n


def test_showing_and_drawing():
    scenes = Scenes()
    scenes.open("first")
    tracemalloc.start()
    begun = time.perf_counter()
    scene = scenes.open("second")
    opened, held = time.perf_counter() - begun, tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()

    def move(k: int) -> None:
        show(
            scene,
            0.05 * k,
            attitude=Attitude(0.01 * (k % 40), 0.05, 0.002 * k),
            p_value=0.001 * (k % 99),
        )

    showing = per_call(move, 5000)
    drawing = per_call(lambda k: (move(k), scene.draw()), 1000) - showing
    print(f"\nload {os.getloadavg()[0]:.1f}; open {1e3 * opened:.1f} ms, {held / 1e6:.2f} MB")
    print(f"show {showing:.1f} us, draw {drawing:.0f} us = {drawing * 20 / 1e4:.2f} % of a core")
    scenes.stop()


def test_watchers_through_the_proxy():
    with scene_site() as site:
        scene = site.scenes.open("f1")
        sockets = [
            connect(
                f"{site.ws}/scene/f1",
                origin=Origin(site.http),
                subprotocols=[SUBPROTOCOL],
                max_size=None,
                max_queue=None,
            )
            for _ in range(N_WATCHERS)
        ]
        begun, used = time.perf_counter(), time.process_time()
        for k in range(100):
            show(scene, 0.05 * k, attitude=Attitude(0.01 * (k % 40), 0.05, 0.002 * k))
            time.sleep(0.05)
        took, cpu = time.perf_counter() - begun, time.process_time() - used
        received = 0
        for socket in sockets:
            socket.close()
            received += sum(len(message) for message in socket)
        print(
            f"\n{N_WATCHERS} watchers at 20 Hz: {100 * cpu / took:.0f} % of a core, their ends "
            f"included; {received / N_WATCHERS / took / 1e3:.0f} kB/s each with the first picture"
        )
