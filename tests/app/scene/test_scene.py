import threading

import pytest
from websockets.sync.client import connect

from app.scene.scene import Scenes
from app.scene.server import credentials
from app.scene.shown import Shown
from tests.support.scene_site import show


class TestScenes:
    def test_there_is_one_scene_a_flight(self):
        scenes = Scenes()
        first = scenes.open("a")
        assert scenes.open("a") is first
        assert scenes.open("b") is not first
        scenes.close("a")
        assert scenes.get("a") is None
        assert scenes.open("c", stale_after_s=0.25)._stale_after_s == 0.25
        scenes.stop()

    def test_stopping_leaves_no_thread_and_no_port(self):
        before = set(threading.enumerate())
        scenes = Scenes()
        addresses = [scenes.open(str(k)).address for k in range(3)]
        scenes.stop()
        with pytest.raises(RuntimeError, match="stopping"):
            scenes.open("late")
        assert set(threading.enumerate()) <= before
        for address in addresses:
            with pytest.raises(OSError, match="refused"):
                connect(address, additional_headers=credentials())

    def test_the_ticker_draws_what_is_watched(self, site):
        scene = site.scenes.open("f1")
        drawn = threading.Event()
        original = scene._picture.draw
        scene._picture.draw = lambda shown: (original(shown), drawn.set())[0]
        with scene.watching(lambda: None):
            drawn.clear()
            show(scene)
            assert drawn.wait(20.0)
        assert "RISK 0.04" in scene._picture._headline.text

    def test_a_scene_that_fails_is_closed_rather_than_frozen(self, caplog):
        scenes = Scenes()
        scene = scenes.open("f1")
        sent_away = threading.Event()

        def fail(shown: Shown) -> None:
            raise ValueError("no paint")

        with scene.watching(sent_away.set):
            scene._picture.draw = fail
            show(scene)
            assert sent_away.wait(20.0)
        scenes.stop()
        assert scenes.get("f1") is None
        assert "f1 failed" in caplog.text

    def test_opening_and_closing_says_nothing_on_the_terminal(self, capfd):
        scenes = Scenes()
        scenes.open("a")
        scenes.stop()
        assert capfd.readouterr() == ("", "")
