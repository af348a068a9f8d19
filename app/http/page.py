"""Serves the page. Its index.html gets preload links to the modules of the first views."""

import re
from collections.abc import Iterator
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import HTMLResponse, Response

ROOTS = ("js/main.js", "js/start/index.js", "js/start/demonstration.js", "js/fly/index.js")
"""Modules of the first views. Preloading saves the browser from finding imports level by level."""
IMPORTED = re.compile(r'^(?:import|export)\b[^"]*?\bfrom "(\.[^"]+)";', re.MULTILINE)


def modules(static: Path) -> list[str]:
    """URL paths of ROOTS and their imports, direct and indirect."""
    reached: dict[Path, None] = {}
    queue = [static / root for root in ROOTS]
    while queue:
        module = queue.pop(0).resolve()
        if module not in reached:
            reached[module] = None
            queue += _imports(module)
    return [f"/{module.relative_to(static.resolve()).as_posix()}" for module in reached]


def _imports(module: Path) -> Iterator[Path]:
    for name in IMPORTED.findall(module.read_text(encoding="utf-8")):
        yield module.parent / name


def serve_page(app: FastAPI, static: Path) -> None:
    """Serve the files of a folder, and its index.html with preload links."""
    links = "".join(f'<link rel="modulepreload" href="{path}">\n' for path in modules(static))
    text = (static / "index.html").read_text(encoding="utf-8")
    page = text.replace("</head>", f"{links}</head>", 1)

    @app.api_route("/", methods=["GET", "HEAD"], include_in_schema=False)
    @app.get("/index.html", include_in_schema=False)
    async def index() -> Response:
        return HTMLResponse(page)

    app.frontend("/", directory=static, fallback=None)
