"""Damaged data are told above every view, in a real Chromium."""

from pathlib import Path

from playwright.sync_api import Page, expect
from sqlalchemy import update

from app.store.tables import monitor_parts
from core.dataset import Dataset
from core.monitor import train
from tests.browser.site import open_site

LONG = 120_000
"""[ms] Until a server checks its data, when it has time for that."""


def test_what_is_damaged_stands_above_every_view_until_it_is_deleted(
    page: Page, tmp_path: Path, dataset: Dataset
) -> None:
    with open_site(tmp_path) as site:
        monitor = site.store.monitors.add(train(dataset), "doublet").id
        page.goto(f"{site.http}/#/monitors")
        expect(page.get_by_role("link", name="doublet", exact=True)).to_be_visible()
        notice = page.locator("#damage")
        expect(notice).to_be_hidden()
        with site.store.engine.begin() as connection:
            connection.execute(update(monitor_parts).values(content=b"something else"))
        page.goto("about:blank")
        site.stop()
        newer = tmp_path / "recordings" / "0123456789ab"
        newer.mkdir(parents=True)
        site.start_again()
        page.goto(f"{site.http}/#/fly")
        expect(notice).to_contain_text("not served: monitor doublet", timeout=LONG)
        page.goto(f"{site.http}/#/recordings")
        expect(notice).to_be_visible()
        assert page.locator("#page").bounding_box()["height"] > 500  # pyright: ignore
        site.store.monitors.delete(monitor)
        page.goto(f"{site.http}/#/fly")
        expect(notice).to_contain_text("Files of 1 recording or flight are not in this database")
        newer.rmdir()
        page.goto(f"{site.http}/#/monitors")
        expect(notice).to_be_hidden()
        page.goto("about:blank")
