"""The page's first file, with links to the modules that its browser is about to ask for."""

import re
from collections.abc import Iterator
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import HTMLResponse, Response

ROOTS = ("js/main.js", "js/start/index.js", "js/start/demonstration.js", "js/fly/index.js")
"""Modules of the first views: the browser loads what they import at once, not level by level."""
IMPORTED = re.compile(r'^(?:import|export)\b[^"]*?\bfrom "(\.[^"]+)";', re.MULTILINE)


def modules(static: Path) -> list[str]:
    """Paths of ROOTS and of all that they import, as the page addresses them."""
    found: dict[Path, None] = {}
    waiting = [static / root for root in ROOTS]
    while waiting:
        module = waiting.pop(0).resolve()
        if module not in found:
            found[module] = None
            waiting += _imports(module)
    return [f"/{module.relative_to(static.resolve()).as_posix()}" for module in found]


def _imports(module: Path) -> Iterator[Path]:
    for name in IMPORTED.findall(module.read_text(encoding="utf-8")):
        yield module.parent / name


def serve_page(app: FastAPI, static: Path) -> None:
    """Serve the files of a folder, and its index.html with the links."""
    links = "".join(f'<link rel="modulepreload" href="{path}">\n' for path in modules(static))
    text = (static / "index.html").read_text(encoding="utf-8")
    page = text.replace("</head>", f"{links}</head>", 1)

    @app.get("/", include_in_schema=False)
    @app.get("/index.html", include_in_schema=False)
    async def index() -> Response:
        return HTMLResponse(page)

    app.frontend("/", directory=static, fallback=None)
