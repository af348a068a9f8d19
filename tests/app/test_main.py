import re

import pytest
from fastapi.routing import APIRoute
from starlette.testclient import TestClient

from app.main import STATIC, create_app
from app.settings import Settings
from tests.support.api import ADDRESS

OUTSIDE = re.compile(
    r"""(?:\b(?:src|href)\s*=\s*["']|\burl\(\s*["']?|\bimport\b[^;'"]*["']|\bfrom\s*["'])"""
    r"""(?:https?:)?//"""
)


def test_the_page_loads_nothing_from_other_servers():
    assert OUTSIDE.search("<link rel=stylesheet href='//fonts.example/a.css'>")
    assert OUTSIDE.search('const plot = await import("https://esm.example/plot");')
    files = [file for file in STATIC.rglob("*") if file.suffix in (".html", ".js", ".css", ".svg")]
    assert len(files) > 50
    assert [file.name for file in files if OUTSIDE.search(file.read_text(encoding="utf-8"))] == []


def test_every_route_is_built_before_the_first_request(tmp_path, monkeypatch):
    app = create_app(Settings(data_dir=tmp_path))

    def late(route: APIRoute):
        pytest.fail(f"{route.path} is built by a request")

    monkeypatch.setattr(APIRoute, "get_route_handler", late)
    with TestClient(app, base_url=ADDRESS) as client:
        assert client.get("/api/v1/monitors").json() == []
        assert client.get("/nowhere").status_code == 404
