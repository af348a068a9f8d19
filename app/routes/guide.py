"""The guide: Markdown pages of `static/guide` as HTML, with contents, search and anchors.

The files are readable on GitHub as they are, so headings have the same anchors as there.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from textwrap import shorten
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader
from markdown_it import MarkdownIt
from markdown_it.token import Token

SLUGS = (
    "what-the-numbers-mean",
    "first-monitor",
    "first-recording",
    "first-live-flight",
    "own-simulator",
    "nonlinear-aircraft",
    "campaigns",
    "alarms-and-keys",
    "limit-sets",
    "several-people",
    "keeping-data",
    "several-machines",
    "several-servers",
    "without-a-network",
    "open-mct",
    "mqtt",
    "grafana",
    "rest-and-streams",
    "command-line",
    "method",
    "glossary",
)
"""The pages in reading order after the first page, README.md at /guide."""
EXCERPT = 160
"""Longest excerpt of a section in search results [characters]."""
MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")
TEMPLATE = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
).get_template("guide.html")


@dataclass(frozen=True)
class GuideSection:
    """A heading and the plain text below it. level: 1 for the title of the page."""

    level: int
    title: str
    anchor: str
    text: str


@dataclass(frozen=True)
class GuidePage:
    """One page of the guide. slug: empty for the first page."""

    slug: str
    body: str
    sections: tuple[GuideSection, ...]

    @property
    def title(self) -> str:
        return self.sections[0].title


def guide_router(directory: Path) -> APIRouter:
    """Serve the pages of a directory at /guide; the first request reads them."""
    router = APIRouter(include_in_schema=False)

    @cache
    def pages() -> dict[str, GuidePage]:
        return {slug: _read(directory, slug) for slug in ("", *SLUGS)}

    @router.get("/guide")
    def contents(q: Annotated[str, Query(max_length=200)] = "") -> HTMLResponse:
        words = q.strip()
        return _answer(pages(), "", words=words, matches=[*find(pages(), words)] if words else [])

    @router.get("/guide/{slug}")
    def page(slug: str) -> HTMLResponse:
        slug = slug.removesuffix(".md")
        if slug == "README":
            return _answer(pages(), "")
        if slug not in SLUGS:
            raise HTTPException(404, f"the guide has no page {slug!r}: choose {', '.join(SLUGS)}")
        return _answer(pages(), slug)

    return router


def _answer(pages: dict[str, GuidePage], slug: str, **search: Any) -> HTMLResponse:
    """A page, or with `words` and `matches` the results of a search in its place."""
    order = ["", *SLUGS]
    place = order.index(slug)
    context = {
        "title": pages[slug].title,
        "slug": slug,
        "body": pages[slug].body,
        "pages": [pages[key] for key in SLUGS],
        "before": pages[order[place - 1]] if place else None,
        "after": pages[order[place + 1]] if place + 1 < len(order) else None,
    }
    return HTMLResponse(TEMPLATE.render(context | search))


def find(pages: dict[str, GuidePage], query: str) -> Iterator[tuple[GuidePage, GuideSection, str]]:
    """Sections with all words of a query, those with a word in the title first."""
    words = query.lower().split()
    matches = [
        (page, section)
        for page in (pages[slug] for slug in SLUGS)
        for section in page.sections
        if all(word in f"{section.title} {section.text}".lower() for word in words)
    ]
    matches.sort(key=lambda match: not any(word in match[1].title.lower() for word in words))
    for page, section in matches:
        yield page, section, _excerpt(section.text, words)


def _excerpt(text: str, words: list[str]) -> str:
    """The text around the first of the words in it."""
    places = [place for word in words if (place := text.lower().find(word)) >= 0]
    start = max(0, min(places, default=0) - EXCERPT // 3)
    start = text.rfind(" ", 0, start) + 1 if start else 0
    return ("… " if start else "") + shorten(text[start:], EXCERPT, placeholder=" …")


def _read(directory: Path, slug: str) -> GuidePage:
    text = (directory / f"{slug or 'README'}.md").read_text(encoding="utf-8")
    tokens = MARKDOWN.parse(text)
    sections: list[GuideSection] = []
    anchors: set[str] = set()
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            title = _plain(tokens[place + 1])
            anchor = anchor_of(title, anchors)
            anchors.add(anchor)
            token.attrSet("id", anchor)
            sections.append(GuideSection(int(token.tag[1]), title, anchor, ""))
        elif token.type in ("inline", "fence") and tokens[place - 1].type != "heading_open":
            last = sections.pop()
            text = f"{last.text} {_plain(token)}".strip()
            sections.append(GuideSection(last.level, last.title, last.anchor, text))
        for child in token.children or ():
            _point(child)
    body = MARKDOWN.renderer.render(tokens, MARKDOWN.options, {})
    body = body.replace("<table>", '<div class="table-scroll"><table class="table">')
    return GuidePage(slug, body.replace("</table>", "</table></div>"), tuple(sections))


def _point(token: Token) -> None:
    """Turn a link between files into one between pages, and a picture's into its address."""
    if token.type == "link_open":
        file, hash_mark, anchor = str(token.attrGet("href")).partition("#")
        if file.endswith(".md") and "/" not in file:
            slug = file.removesuffix(".md")
            address = "/guide" if slug == "README" else f"/guide/{slug}"
            token.attrSet("href", address + hash_mark + anchor)
    elif token.type == "image":
        token.attrSet("src", f"/guide/{token.attrGet('src')}")


def _plain(token: Token) -> str:
    """The text of a token without its markup."""
    if token.children is None:
        return " ".join(token.content.split())
    parts = (" " if child.type == "softbreak" else child.content for child in token.children)
    return "".join(parts)


def anchor_of(title: str, taken: set[str]) -> str:
    """The anchor of a heading as on GitHub. taken: anchors of the page so far."""
    plain = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
    numbered = (f"{plain}-{number}" for number in range(1, len(taken) + 1))
    return plain if plain not in taken else next(a for a in numbered if a not in taken)
