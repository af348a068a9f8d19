"""Rules of every page: headings, names, contrast, no blank space, own files only."""

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from core import __version__
from tests.browser.chromium import violations_of_themes
from tests.browser.recorded_site import RecordedSite

VIEWS = [
    "",
    "fly",
    "recordings",
    "recordings/{recording}",
    "recordings/{recording}?scoring={scoring}",
    "recordings/{recording}?compare={scoring}",
    "monitors",
    "monitors/new",
    "monitors/new?recording={recording}",
    "monitors/combine",
    "monitors/sweep",
    "monitors/{monitor}",
    "nowhere",
    "datasets",
    "datasets/new",
    "datasets/rollouts",
    "campaigns",
    "campaigns/new",
    "limits",
    "limits/{limits}",
    "sets",
    "sets/{set}",
    "storage",
    "people",
]
FINDINGS = """() => {
    const words = (text) => text.toLowerCase().match(/[\\p{L}\\p{N}]+/gu)?.join(" ") ?? "";
    const isShown = (node) =>
        !node.matches(".visually-hidden") && getComputedStyle(node).display !== "none";
    const shown = (element) => [...element.childNodes]
        .filter((node) => node.nodeType === Node.TEXT_NODE || isShown(node))
        .map((node) => (node.nodeType === Node.TEXT_NODE ? node.data : shown(node)))
        .join("");
    const found = [];
    if (document.querySelectorAll("h1").length === 0) found.push("no heading of level 1");
    for (const head of document.querySelectorAll("th"))
        if (head.textContent.trim() === "") found.push(`empty: ${head.parentElement.textContent}`);
    for (const named of document.querySelectorAll(":is(button, a, [role=button])[aria-label]"))
        if (!words(named.getAttribute("aria-label")).includes(words(shown(named))))
            found.push(`${shown(named)} is named ${named.getAttribute("aria-label")}`);
    for (const { name } of performance.getEntriesByType("resource"))
        if (!name.startsWith(`${location.origin}/`)) found.push(`from another server: ${name}`);
    return found;
}"""
BLANK = """() => {
    const page = document.querySelector(".page");
    const parts = [...page.children];
    const box = page.getBoundingClientRect();
    const bottom = Math.max(...parts.map((part) => part.getBoundingClientRect().bottom));
    const end = Math.max(bottom - box.top + page.scrollTop + 40, page.clientHeight);
    return Math.max(page.scrollHeight - end, document.documentElement.scrollHeight - innerHeight);
}"""
"""Pixels that page or document scroll beyond the last part of the page."""
CUT = """() => {
    const pen = document.createElement("canvas").getContext("2d");
    const shown = [...document.querySelectorAll("select")].filter((one) => one.checkVisibility());
    return shown.filter((one) => {
        const { font, paddingLeft: left, paddingRight: right } = getComputedStyle(one);
        pen.font = font;
        const room = one.clientWidth - parseFloat(left) - parseFloat(right);
        return pen.measureText(one.selectedOptions[0].text).width > room;
    }).map((one) => one.selectedOptions[0].text);
}"""
"""Chosen words that their control cuts."""
GUIDE = Path(__file__).parents[2] / "static" / "guide"


def sections(slug: str) -> set[str]:
    """Anchors of a page of the guide."""
    heads = re.findall(r"^#+ (.+)$", (GUIDE / f"{slug}.md").read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.fixture(scope="module")
def ids(site: RecordedSite) -> dict[str, Any]:
    recording = site.upload()
    site.confirm(recording)
    limits = {"name": "any condition", "ranges": {}, "limits": {"Ny": 0.4}}
    made = site.ask("POST", "/limit-sets", json={"name": "transport", "cases": [limits]})
    cases = [{"name": "subsonic", "ranges": {"mach": [0, 1]}, "monitor": site.monitor}]
    monitor_set = site.ask("POST", "/monitor-sets", json={"name": "doublet", "cases": cases})
    return {
        "recording": recording,
        "scoring": site.score(recording)["id"],
        "monitor": site.monitor,
        "limits": made["limit_set"],
        "set": monitor_set["id"],
    }


@pytest.mark.parametrize("view", VIEWS)
def test_every_page_keeps_the_rules(
    page: Page, site: RecordedSite, ids: dict[str, Any], view: str, allowed_errors: list[str]
) -> None:
    if view == "monitors/{monitor}":
        allowed_errors.append("/evaluation")  # the monitor was never flown
    page.evaluate("document.querySelector('.page')?.setAttribute('data-before', '')")
    page.goto(f"{site.http}/#/{view.format(**ids)}")
    expect(page.locator(".page:not([data-before])")).to_be_visible()
    expect(page.locator(":is(.state-loading, .state-error)")).to_have_count(0)
    expect(page.locator("h1").first).to_be_visible()
    expect(page.locator(".masthead .version")).to_have_text(__version__)
    assert page.evaluate(FINDINGS) == []
    for link in page.locator(".guide-link").all():
        slug, _, anchor = (link.get_attribute("href") or "").removeprefix("/guide/").partition("#")
        assert not anchor or anchor in sections(slug), (slug, anchor)
    page.evaluate("document.querySelectorAll('details').forEach((part) => (part.open = true))")
    assert violations_of_themes(page) == {}
    for width in (1024, 1440):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate(BLANK) <= 0, width
        assert page.evaluate(CUT) == [], width


def test_an_address_of_the_guide_in_the_page_opens_the_guide(page: Page, site: RecordedSite):
    page.goto(f"{site.http}/#/guide/limit-sets")
    expect(page).to_have_url(f"{site.http}/guide/limit-sets")
