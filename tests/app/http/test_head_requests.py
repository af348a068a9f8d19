"""Every GET route answers HEAD."""

from collections.abc import Iterator

import pytest
from starlette.testclient import TestClient

from tests.app.access.test_roles import ROUTES
from tests.support.api import api


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with api(tmp_path_factory.mktemp("data"), max_jobs=0) as client:
        yield client


@pytest.mark.parametrize("path", [path for method, path in ROUTES if method == "GET"])
def test_head_has_the_status_and_the_type_of_get_and_no_body(client: TestClient, path: str) -> None:
    get, head = client.get(path), client.head(path)
    assert head.content == b""
    assert head.status_code == get.status_code
    assert head.headers.get("content-type") == get.headers.get("content-type")
