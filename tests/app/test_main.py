import pytest
from fastapi.routing import APIRoute
from starlette.testclient import TestClient

from app.main import create_app
from app.settings import Settings
from tests.support.api import ADDRESS


def test_every_route_is_built_before_the_first_request(tmp_path, monkeypatch):
    app = create_app(Settings(data_dir=tmp_path))

    def late(route: APIRoute):
        pytest.fail(f"{route.path} is built by a request")

    monkeypatch.setattr(APIRoute, "get_route_handler", late)
    with TestClient(app, base_url=ADDRESS) as client:
        assert client.get("/api/v1/monitors").json() == []
        assert client.get("/nowhere").status_code == 404
