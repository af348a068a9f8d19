import re
from itertools import pairwise

import pytest
from starlette.testclient import TestClient

from app.main import STATIC, create_app
from app.routes.guide import SLUGS, anchor_of
from app.settings import Settings
from tests.support.places import ROOT

GUIDE = STATIC / "guide"
FILES = ["README", *SLUGS]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> TestClient:
    app = create_app(Settings(data_dir=tmp_path_factory.mktemp("data")))
    return TestClient(app, base_url="http://127.0.0.1:8000")


def address(file: str) -> str:
    return "/guide" if file == "README" else f"/guide/{file}"


@pytest.mark.parametrize("file", FILES)
def test_a_page_has_one_title_and_an_anchor_at_each_heading(client: TestClient, file: str):
    answer = client.get(address(file))
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    assert len(re.findall("<h1[ >]", answer.text)) == 1
    ids = re.findall(r'<h[1-6] id="([^"]+)"', answer.text)
    assert len(ids) == len(re.findall("<h[1-6]", answer.text)) == len(set(ids))


@pytest.mark.parametrize("file", FILES)
def test_links_between_pages_lead_to_a_heading_here_and_on_github(client: TestClient, file: str):
    text = (GUIDE / f"{file}.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)]+)\)", text):
        name, _, anchor = target.partition("#")
        if name.startswith("pictures/"):
            assert client.get(f"/guide/{name}").status_code == 200, name
            continue
        to = name.removesuffix(".md") or file
        assert name in ("", f"{to}.md")
        answer = client.get(address(to))
        assert answer.status_code == 200, target
        assert not anchor or f'id="{anchor}"' in answer.text, target
    served = client.get(address(file)).text
    assert not re.search(r'(?:href|src)="(?!/|#|data:)', served)


def test_a_page_is_found_under_the_name_of_its_file_too(client: TestClient):
    assert client.get("/guide/glossary.md").text == client.get("/guide/glossary").text
    assert client.get("/guide/README.md").text == client.get("/guide").text
    assert client.get("/guide/").text == client.get("/guide").text


def test_an_unknown_page_is_refused_with_the_pages_that_exist(client: TestClient):
    answer = client.get("/guide/nonsense")
    assert answer.status_code == 404
    assert "glossary" in answer.json()["detail"]


def test_pages_follow_one_another(client: TestClient):
    for one, other in pairwise(FILES):
        assert f'rel="next" href="{address(other)}"' in client.get(address(one)).text
    assert 'rel="next"' not in client.get(address(FILES[-1])).text


def test_the_search_finds_sections_that_have_all_words(client: TestClient):
    found = client.get("/guide", params={"q": "acknowledge KEY"}).text
    assert 'href="/guide/alarms-and-keys#keys"' in found
    assert "/guide/keeping-data#restore" not in found.partition("<main")[2]
    title_first = client.get("/guide", params={"q": "restore"}).text.partition("<main")[2]
    assert re.findall(r'<a href="([^"]+)"', title_first)[0] == "/guide/keeping-data#restore"


def test_an_empty_search_result_is_reported_with_the_words_escaped(client: TestClient):
    answer = client.get("/guide", params={"q": "<b>zebra</b>"}).text
    assert "No section" in answer
    assert "<b>zebra" not in answer


def test_a_heading_that_is_repeated_is_numbered_as_on_github():
    assert anchor_of("ABORT, or not?", set()) == "abort-or-not"
    assert anchor_of("Keys", {"keys"}) == "keys-1"


def test_every_picture_is_used_and_all_are_small():
    files = [GUIDE / f"{file}.md" for file in FILES]
    texts = "".join(file.read_text(encoding="utf-8") for file in [*files, ROOT / "README.md"])
    pictures = [*(GUIDE / "pictures").iterdir()]
    assert [picture.name for picture in pictures if f"pictures/{picture.name}" not in texts] == []
    assert sum(picture.stat().st_size for picture in pictures) < 2_000_000
