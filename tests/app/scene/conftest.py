"""A scene that is drawn by hand, and one behind a real server."""

import pytest

from app.scene.scene import Scene
from core.simulation.attitude import SurfaceSigns
from tests.support.scene_site import scene_site


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
