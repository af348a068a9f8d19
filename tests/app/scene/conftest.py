"""A scene that is drawn by hand, and one behind a real server."""

import pytest

from app.scene.scene import Scene
from core.simulation.attitude import SurfaceSigns
from tests.support.scene_site import scene_site


class Clock:
    """Time that passes only when told."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def scene(clock):
    """A scene that is drawn by hand."""
    scene = Scene(clock, SurfaceSigns(1, -1), 0.0, stale_after_s=2.0)
    yield scene
    scene.close()


@pytest.fixture
def site():
    with scene_site() as site:
        yield site
