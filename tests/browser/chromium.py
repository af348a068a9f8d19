"""A real Chromium, and a server of the page's files on loopback: what every browser test needs."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

ROOT = Path(__file__).parents[2]
PAGES = {"/static/": ROOT / "static", "/browser/": ROOT / "tests" / "browser"}
NAMES = ("chromium-headless-shell", "chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


class _Files(SimpleHTTPRequestHandler):
    """Serves PAGES under a policy that lets nothing in from outside."""

    def translate_path(self, path: str) -> str:
        path = path.split("?")[0]
        prefix = next((prefix for prefix in PAGES if path.startswith(prefix)), None)
        if prefix is None or ".." in path:
            return str(ROOT / "no such file")
        return str(PAGES[prefix] / path.removeprefix(prefix))

    def end_headers(self) -> None:
        self.send_header("Content-Security-Policy", "default-src 'self'; img-src 'self' data:")
        self.send_header("Cache-Control", "max-age=600")
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing."""


@contextmanager
def file_server() -> Iterator[str]:
    """Serve static/ at /static/ and tests/browser/ at /browser/; yields the origin."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Files)) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def open_chromium(*arguments: str) -> Iterator[Browser]:
    """Start Chromium (FOREWARN_CHROMIUM or the one on the path); skips where there is none.

    The headless shell comes first: without windows it takes half the processor time.
    """
    path = os.environ.get("FOREWARN_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no Chromium: apt-get install chromium, or set FOREWARN_CHROMIUM to its path")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*ARGUMENTS, *arguments])
        try:
            yield browser
        finally:
            browser.close()


def watch_errors(page: Page) -> list[str]:
    """Collect what a flawless page never says: console errors and warnings, exceptions."""
    errors: list[str] = []

    def read(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            errors.append(f"{message.type}: {message.text} [{message.location['url']}]")

    page.on("pageerror", lambda error: errors.append(f"exception: {error}"))
    page.on("console", read)
    return errors


def wait_until(page: Page, condition: str, seconds: float = 20) -> None:
    """Wait until a JavaScript expression, or what it promises, is true.

    Playwright's own wait_for_function evaluates strings in the page, which its policy forbids.
    """
    page.evaluate(
        f"""() => new Promise((done, fail) => {{
            const late = performance.now() + {1000 * seconds};
            const look = async () => {{
                if (await ({condition})) done();
                else if (performance.now() > late) fail(new Error({condition!r} + " never held"));
                else requestAnimationFrame(() => look().catch(fail));
            }};
            look().catch(fail);
        }})"""
    )


Violations = list[tuple[str, list[str]]]
"""Rules of axe, and where the page breaks them."""
COLOURS = ["color-contrast", "link-in-text-block"]
"""The rules of axe that look at colours: all that a theme changes."""


def violations(page: Page, rules: list[str] | None = None) -> Violations:
    """What axe finds against WCAG, or against these rules of it."""
    only = {"runOnly": rules} if rules else {}
    found = Axe().run(page, options={"resultTypes": ["violations"]} | only).response["violations"]
    return [(rule["id"], [node["html"] for node in rule["nodes"]]) for rule in found]


def violations_of_themes(page: Page) -> dict[str, Violations]:
    """What axe finds in the light theme, and of colours in the dark one; empty if nothing."""
    page.emulate_media(color_scheme="light")
    light = violations(page)
    page.emulate_media(color_scheme="dark")
    found = {"light": light, "dark": violations(page, COLOURS)}
    return {theme: broken for theme, broken in found.items() if broken}
