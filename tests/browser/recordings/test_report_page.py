"""The report in a real Chromium: on paper nothing is cut off, and its pages are whole."""

import re
import zlib
from typing import Any

import pytest
from playwright.sync_api import Page

from app.report.page import report
from core.dataset import Dataset
from core.monitor import MonitorRecipe, train
from tests.support.reported import exceedance, manoeuvre, subject_of

PAPER = {"width": 688, "height": 1000}
"""[px] A4 within the margins."""
LONG = "rudder doublet at flight level one hundred and sixty, flaps and gear up, and again"
OUTCOMES = ["quiet", "timely_alert", "invalid", "false_alert", "missed", "late_alert"]


def thirty() -> list[dict[str, Any]]:
    """Thirty manoeuvres of every outcome, one with a name that is far too long."""
    made = []
    for k in range(30):
        outcome, more = OUTCOMES[k % len(OUTCOMES)], {}
        start = manoeuvre(k, outcome)["start"]
        if outcome in ("timely_alert", "late_alert", "missed"):
            more["exceedance"] = exceedance(k)
        if "alert" in outcome:
            more["alerts"] = [[start + 1.5, start + 1.6]]
        made.append(manoeuvre(k, outcome, **more))
    made[3]["name"] = LONG
    return made


@pytest.fixture
def paper(page: Page, dataset: Dataset) -> Page:
    """The report of thirty manoeuvres, laid out for paper."""
    subject = subject_of(train(dataset, MonitorRecipe()), thirty())
    page.set_viewport_size(PAPER)  # pyright: ignore[reportArgumentType]
    page.emulate_media(media="print")
    page.set_content(report(subject))
    return page


def test_it_prints_as_a_pdf_of_many_pages(paper: Page) -> None:
    pdf = paper.pdf(prefer_css_page_size=True)
    assert pdf.startswith(b"%PDF-")
    n_pages = len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf))
    assert 30 < n_pages < 40
    assert len(pdf) < 5_000_000
    (size,) = set(re.findall(rb"/MediaBox\s*\[([^\]]*)\]", pdf))
    assert [round(float(side)) for side in size.split()] == [0, 0, 595, 842]


def test_nothing_reaches_over_the_edge_of_the_paper(paper: Page) -> None:
    assert paper.evaluate("document.documentElement.scrollWidth") <= PAPER["width"]
    cut = paper.evaluate(
        """() => [...document.querySelectorAll("td, th")]
            .filter((cell) => cell.scrollWidth > cell.clientWidth + 1)
            .map((cell) => cell.textContent)"""
    )
    assert cut == []


TORN = """() => {
    const torn = [], range = document.createRange();
    for (const cell of document.querySelectorAll("td, th")) {
        const texts = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
        while (texts.nextNode()) {
            const { currentNode: text } = texts;
            for (const { 0: word, index } of text.data.matchAll(/[^\\s-]{1,24}/g)) {
                range.setStart(text, index);
                range.setEnd(text, index + word.length);
                const tops = [...range.getClientRects()].map(({ top }) => Math.round(top));
                if (new Set(tops).size > 1) torn.push(word);
            }
        }
    }
    return torn;
}"""
"""Words of tables that go on in another line."""


def test_no_word_of_a_table_is_torn(paper: Page) -> None:
    assert "INVALID" in paper.locator(".manoeuvres").inner_text()
    assert paper.evaluate(TORN) == []


def words_by_page(pdf: bytes) -> list[int]:
    """How many pieces of text each page of Chromium's PDF shows."""
    objects = dict(re.findall(rb"\n(\d+) 0 obj\n(.*?)\nendobj", pdf, re.DOTALL))
    pages = [body for body in objects.values() if re.search(rb"/Type\s*/Page\b(?!s)", body)]
    shown = []
    for page in pages:
        (number,) = re.findall(rb"/Contents (\d+) 0 R", page)
        content = objects[number].partition(b"stream\n")[2]
        shown.append(len(re.findall(rb"T[jJ]\b", zlib.decompressobj().decompress(content))))
    return shown


def test_no_page_before_the_first_manoeuvre_is_nearly_blank(page: Page, dataset: Dataset) -> None:
    start = manoeuvre(0, "false_alert")["start"]
    flown = manoeuvre(
        0,
        "false_alert",
        alerts=[[start + 0.1 * k, start + 0.1 * k + 0.05] for k in range(2)],
        remarks=["it was flown as nobody had planned it"] * 16,
    )
    page.set_content(report(subject_of(train(dataset, MonitorRecipe()), [flown])))
    *before, _ = words_by_page(page.pdf(prefer_css_page_size=True))
    assert len(before) > 1
    assert min(before) > max(before) / 2


def test_every_word_of_a_picture_lies_within_it(paper: Page) -> None:
    outside = paper.evaluate(
        """() => [...document.querySelectorAll(".chart text")].filter((text) => {
            const word = text.getBoundingClientRect();
            const all = text.ownerSVGElement.getBoundingClientRect();
            return word.left < all.left - 0.5 || word.right > all.right + 0.5
                || word.top < all.top - 0.5 || word.bottom > all.bottom + 0.5;
        }).map((text) => text.textContent)"""
    )
    assert outside == []
    assert paper.locator(".chart").count() == 32


def test_a_manoeuvre_is_not_torn_apart_and_the_table_says_its_columns_again(paper: Page) -> None:
    style = """(element, name) => getComputedStyle(element)[name]"""
    for section in paper.locator("section:not(:nth-of-type(2)), .together").all():
        assert section.evaluate(style, "breakInside") == "avoid"
    heights = paper.evaluate("[...document.querySelectorAll('section')].map((s) => s.offsetHeight)")
    assert max(heights) < PAPER["height"]
    assert paper.locator("thead").first.evaluate(style, "display") == "table-header-group"


def test_on_a_screen_the_wide_table_scrolls_by_itself(paper: Page) -> None:
    paper.emulate_media(media="screen")
    paper.set_viewport_size({"width": 420, "height": 800})
    assert paper.evaluate("document.documentElement.scrollWidth") <= 420
