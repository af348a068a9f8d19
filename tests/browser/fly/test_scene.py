import numpy as np
import pytest
from playwright.sync_api import Frame, Page

from app.scene.picture import CAMERAS
from core.monitor.assessment import State
from core.simulation.attitude import Attitude
from tests.support.scene_site import Site, scene_site, show

EXPECTED = [
    "THREE.Clock: This module has been deprecated",
    "GPU stall due to ReadPixels",
]
CANVAS = "canvas[data-engine]"
COUNT = """
wanted => {
    const canvas = document.querySelector("canvas[data-engine]");
    if (!canvas) return false;
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
    copy.fillStyle = "#16283c";  // the sky is the page's: the canvas is transparent there
    copy.fillRect(0, 0, canvas.width, canvas.height);
    copy.drawImage(canvas, 0, 0);
    const pixels = copy.getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    const found = {red: 0, teal: 0, grey: 0, colours: 0};
    for (let i = 0; i < pixels.length; i += 4) {
        const [r, g, b] = pixels.subarray(i, i + 3);
        colours.add((r >> 3) << 10 | (g >> 3) << 5 | b >> 3);
        if (r > 180 && g < 90 && b < 90) found.red++;
        if (g > 120 && b > 110 && r < 0.75 * g && Math.abs(g - b) < 40) found.teal++;
        if (r > 70 && r < 200 && Math.abs(r - g) < 8 && Math.abs(g - b) < 12) found.grey++;
    }
    found.colours = colours.size;
    const fits = Object.entries(wanted).every(([name, [low, high]]) =>
        found[name] >= low && found[name] <= high);
    return fits && found;
}
"""
"""Counts pixels of the scene by colour; true once each count lies in its range."""

MANY = 10**9
CALM = {"colours": [200, MANY], "teal": [300, MANY], "red": [0, 0]}
ALERT = {"colours": [200, MANY], "red": [800, MANY], "teal": [0, 60]}
SILENT = {"grey": [6000, MANY], "red": [0, 0], "teal": [0, 60]}


@pytest.fixture
def site(allowed_errors):
    allowed_errors += EXPECTED
    with scene_site() as site:
        yield site


@pytest.fixture
def page(own_page: Page) -> Page:
    """A separate page: it is listened to."""
    return own_page


@pytest.fixture
def asked(page: Page) -> list[str]:
    """Addresses that the page asks for, WebSockets included."""
    page.set_viewport_size({"width": 640, "height": 400})
    addresses: list[str] = []
    page.on("request", lambda request: addresses.append(request.url))
    page.on("websocket", lambda websocket: addresses.append(websocket.url))
    return addresses


def settles(page: Page | Frame, wanted: dict) -> None:
    """Wait for the pixels."""
    page.wait_for_function(COUNT, arg=wanted, timeout=60_000)


def test_the_scene_shows_the_state_in_colour(page: Page, site: Site, asked: list[str]):
    scene = site.scenes.open("f1")
    for k in range(60):
        show(scene, 0.05 * k)
        scene.draw()
    page.goto(f"{site.http}/scene/f1/")
    page.wait_for_selector(CANVAS)
    settles(page, CALM)

    for k in range(61, 181):  # until all of the trail is of the alert
        attitude = Attitude(-0.5, 0.05, 0.1)
        show(scene, 0.05 * k, p_value=0.42, alert=True, beta=0.1, attitude=attitude)
        scene.draw()
    settles(page, ALERT)

    show(scene, 20.0, p_value=None, alert=False, state=State.STALE, reason="no sample for 1 s")
    settles(page, SILENT)

    show(scene, 20.05, p_value=None, alert=False, state=State.INVALID, reason="beta is not finite")
    settles(page, SILENT)
    show(scene, 20.10, p_value=None, alert=False, state=State.WARMING_UP)
    settles(page, {"red": [0, 0], "teal": [0, 60]})
    show(scene, 20.15)
    settles(page, CALM)

    own = (site.http, site.ws, "data:", "blob:")
    assert [address for address in asked if not address.startswith(own)] == []
    assert f"{site.ws}/scene/f1" in asked


def test_a_frame_has_no_panel_and_reconnects_without_focus_when_told_to(
    page: Page, site: Site, asked: list[str]
):
    scene = site.scenes.open("f1")
    show(scene)
    page.goto(f"{site.http}/frame/f1")
    (inside,) = page.main_frame.child_frames
    settles(inside, CALM)
    assert not inside.locator(".mantine-Paper-root:visible").count()
    page.evaluate(
        """() => {
            const {contentDocument, contentWindow} = document.getElementById("scene");
            contentDocument.hasFocus = () => true;
            contentWindow.dispatchEvent(new Event("focus"));
        }"""
    )
    scene._server._websock_server.disconnect_all_clients()
    show(scene, 1.05, p_value=0.42, alert=True)
    settles(inside, ALERT | {"red": [300, MANY]})
    assert asked.count(f"{site.ws}/scene/f1") > 1


def test_the_address_names_the_first_camera_and_the_page_changes_it_after_the_mouse(
    page: Page, site: Site, asked: list[str]
):
    scene = site.scenes.open("f1")
    show(scene)
    scene.draw()

    def looks_from(name: str) -> None:
        wanted = CAMERAS[name].position
        for _ in range(200):
            clients = scene._server.get_clients().values()
            if any(np.allclose(each.camera.position, wanted, atol=0.05) for each in clients):
                return
            page.wait_for_timeout(50)
        raise AssertionError(f"no watcher looks from {name}")

    page.goto(f"{site.http}/scene/f1/?camera=tail")
    page.wait_for_selector(CANVAS)
    looks_from("tail")
    page.mouse.move(300, 300)
    page.mouse.down()
    page.mouse.move(200, 320, steps=4)
    page.mouse.up()
    for name in ("side", "chase", "tail"):
        page.evaluate("name => lookFrom(name)", name)
        looks_from(name)


PICTURE = """() => {
  const canvas = document.querySelector("canvas[data-engine]");
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
  copy.drawImage(canvas, 0, 0);
  return copy.getImageData(0, 0, canvas.width, canvas.height).data.join();
}"""


@pytest.mark.usefixtures("asked")
def test_a_page_hides_the_words_of_the_state_alone_or_all_texts(page: Page, site: Site):
    scene = site.scenes.open("f1")
    show(scene, p_value=0.42, alert=True)
    page.goto(f"{site.http}/scene/f1/")
    settles(page, {"colours": [200, MANY]})

    def picture(which: str) -> str:
        """As soon as it no longer changes."""
        page.evaluate("which => showWords(which)", which)
        seen, now = "", page.evaluate(PICTURE)
        while now != seen:
            page.wait_for_timeout(400)
            seen, now = now, page.evaluate(PICTURE)
        return now

    picture("none")
    whole, numbers, none = (picture(which) for which in ("all", "numbers", "none"))
    assert len({whole, numbers, none}) == 3
