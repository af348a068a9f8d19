"""ABORT and KNOCK IT OFF on the page: by key and button, on every screen, and in the record."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.fly.test_fly_page import SAFE, Fly, site, stored
from tests.browser.site import Site

__all__ = ["site", "stored"]
ABORT = "ABORT at 0.00 s, by local"


@pytest.fixture
def fly(page: Page, site: Site) -> Iterator[Fly]:
    fly = Fly(page, site)
    yield fly
    fly.end()


def test_a_key_and_a_button_mark_the_flight_on_every_screen_and_in_its_record(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    other = page.context.new_page()
    other.goto(page.url)
    other.locator('[data-flight="open"]').wait_for()
    page.get_by_label("Speed").focus()
    page.keyboard.press("x")
    shown = [view.locator(".marker-last") for view in (page, other)]
    for one in shown:
        expect(one).to_have_text(ABORT)
    page.get_by_role("button", name="KNOCK IT OFF").click()
    for one in shown:
        expect(one).to_have_text(ABORT)
    for words in ("ABORT (safety of flight)", "KNOCK IT OFF (no useful data)"):
        expect(other.locator(".event", has_text=words)).to_have_count(1)
    other.close()
    page.keyboard.press("?")
    expect(page.locator(".shortcuts")).to_contain_text("ABORT: safety of flight")
    page.keyboard.press("x")
    page.keyboard.press("Escape")
    set_kinds = [one["kind"] for one in fly.ask("GET", f"/flights/{fly.flight}/markers")]
    assert set_kinds == ["abort", "knock_it_off"]
    fly.end()
    record = page.locator(".notice .marker-last")
    expect(record).to_have_count(2)
    expect(record.first).to_contain_text("ABORT (safety of flight) at 0.00 s")
    expect(page.locator(".event", has_text="ABORT (safety of flight)")).to_have_count(1)


def test_an_abort_that_was_not_set_is_said_as_loudly_as_one_that_was(
    fly: Fly, allowed_errors: list[str]
) -> None:
    allowed_errors += ["ERR_FAILED", "503 (Service"]
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    held: list[Route] = []
    page.route("**/markers", lambda route: held.append(route))
    page.keyboard.press("x")
    refused = page.locator(".marker-refused")
    expect(refused).to_have_text(re.compile("^ABORT IS NOT CONFIRMED"))
    held.pop().abort()
    expect(refused).to_have_text(re.compile(r"^ABORT WAS NOT SET\..*Call it by voice\.$"))
    page.unroute("**/markers")
    page.keyboard.press("q")
    expect(page.locator(".marker-last")).to_contain_text("KNOCK IT OFF")
    size = "(one) => [Number.parseFloat(getComputedStyle(one).fontSize), one.dataset.level]"
    page.route("**/markers", lambda route: route.abort())
    page.keyboard.press("x")
    expect(refused).to_contain_text("WAS NOT SET")
    font, level = refused.evaluate(size)
    assert font >= page.locator(".marker-last").evaluate(size)[0]
    assert level == "alert"
    page.unroute("**/markers")
    page.keyboard.press("x")
    expect(refused).to_be_hidden()
    expect(page.locator(".marker-last")).to_have_text(ABORT)


def test_abort_is_set_while_a_question_is_open(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None), ("seek", 0.0))
    page.evaluate("document.body.appendChild(document.createElement('dialog')).showModal()")
    page.keyboard.press("x")
    expect(page.locator(".marker-last")).to_have_text(ABORT)
    page.evaluate("document.querySelector('body > dialog').remove()")


def test_no_key_marks_while_a_text_is_typed_or_modified_or_held(fly: Fly) -> None:
    page = fly.page
    fly.watch(SAFE, ("pause", None))
    page.evaluate("document.body.append(document.createElement('textarea'))")
    page.locator("body > textarea").focus()
    page.keyboard.press("x")
    page.locator("body > textarea").blur()
    page.keyboard.press("Control+q")
    page.keyboard.down("q")
    page.keyboard.down("q")
    page.keyboard.up("q")
    expect(page.locator(".marker-last")).to_contain_text("KNOCK IT OFF")
    markers = fly.ask("GET", f"/flights/{fly.flight}/markers")
    assert [one["kind"] for one in markers] == ["knock_it_off"]
    page.evaluate("document.querySelector('body > textarea').remove()")
