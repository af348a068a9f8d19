"""What a chart saves of the view: a picture that shows it, and its values."""

import csv
import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.browser.strips import Open, run

SVG = "{http://www.w3.org/2000/svg}"
READ = """async (href) => {
    const image = new Image();
    image.src = href;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.width, image.height];
    const pen = canvas.getContext("2d");
    pen.drawImage(image, 0, 0);
    const { data } = pen.getImageData(0, 0, canvas.width, canvas.height);
    const colours = {};
    for (let k = 0; k < data.length; k += 4) {
        const colour = [data[k], data[k + 1], data[k + 2]].join(" ");
        colours[colour] = (colours[colour] ?? 0) + 1;
    }
    return [canvas.width, canvas.height, colours];
}"""


def saved(page: Page, kind: str, folder: Path) -> Path:
    page.locator(".view-menu summary").click()
    with page.expect_download() as download:
        page.get_by_role("button", name=f"as {kind}").click()
    page.keyboard.press("Escape")
    target = folder / download.value.suggested_filename
    download.value.save_as(target)
    return target


@pytest.fixture
def flown(strips: Open) -> Page:
    page = strips("seconds=20")
    run(page, "h.feed(0, 15, 1000); h.draw(1000)")
    return page


def test_a_picture_names_its_strips_and_draws_their_traces(flown: Page, tmp_path: Path) -> None:
    root = ElementTree.parse(saved(flown, "SVG", tmp_path)).getroot()
    texts = {text.text for text in root.iter(f"{SVG}text")}
    assert {"N_y lateral acceleration [g]", "risk higher is worse", "t [s]"} <= texts
    trace = flown.evaluate(
        "getComputedStyle(document.documentElement).getPropertyValue('--trace').trim()"
    )
    lines = [path.get("d", "") for path in root.iter(f"{SVG}path") if trace in path.attrib.values()]
    assert sum(d.count("L") for d in lines) > 7 * 500  # seven strips, hundreds of columns each


def test_pixels_show_what_the_page_shows(flown: Page, tmp_path: Path) -> None:
    path = saved(flown, "PNG", tmp_path)
    flown.context.route("**/saved.png", lambda route: route.fulfill(path=path))
    width, height, colours = flown.evaluate(READ, "/saved.png")
    canvas = flown.locator(".strip canvas").first.bounding_box()
    assert canvas is not None
    assert (width, height > 7 * canvas["height"]) == (2 * round(canvas["width"]), True)
    assert max(colours.values()) < 0.95 * width * height, "an empty picture"


def test_values_are_those_in_view_in_the_units_shown(flown: Page, tmp_path: Path) -> None:
    head, *rows = csv.reader(io.StringIO(saved(flown, "CSV", tmp_path).read_text()))
    assert head[:3] == ["t [s]", "Ny least [g]", "Ny greatest [g]"]
    times, least, greatest = np.array([row[:3] for row in rows], float).T
    assert (times[0], times[-1]) == pytest.approx((0, 15), abs=0.1)
    flight = run(flown, "return Array.from({ length: 751 }, (_, k) => h.frame(k / 50).y[3])")
    assert (least.min(), greatest.max()) == pytest.approx((min(flight), max(flight)), rel=1e-5)
