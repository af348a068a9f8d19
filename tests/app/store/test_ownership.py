"""One process serves a database; the work of one that does is left alone."""

from pathlib import Path

import pytest

from app.serving import alone
from app.settings import Settings, SettingsError
from app.store.ownership import Taken
from app.store.store import open_store
from tests.support.store_writer import serve_a_job, start


def test_work_is_interrupted_only_when_its_owner_is_gone(url: str, tmp_path: Path) -> None:
    server, reports = start(serve_a_job, url)
    (job,) = reports.recv()
    store = open_store(url)
    try:
        assert store.jobs.info(job).status == "running"
        with pytest.raises(Taken, match="another forewarn serves"), store.owned():
            pass
        apart = Settings(data_dir=tmp_path / "apart", database_url=url)
        with pytest.raises(SettingsError, match="choose other data with --database-url"):
            alone(apart).__enter__()
        server.kill()
        server.join()
        with alone(apart):
            store.recover()
            assert store.jobs.info(job).status == "interrupted"
    finally:
        server.kill()
        store.close()


def test_a_process_owns_a_database_as_often_as_it_likes(url: str) -> None:
    store = open_store(url)
    with store.owned(), store.owned():
        store.jobs.add("a", {})
    with store.owned():
        store.jobs.add("b", {})
    store.close()
