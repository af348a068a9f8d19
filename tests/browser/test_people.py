"""Each role's page in a real Chromium: who is logged in, what is offered, what is refused."""

from pathlib import Path

import httpx2
import pytest
from playwright.sync_api import Locator, Page, expect

from app.store.people import Role
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from tests.browser.site import open_site

TOKEN = "a-token-of-the-control-room"
OWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    """The scene is hidden: it is slow to draw here."""
    return {"forewarn.scene": "hidden"}


CONTROLS = (
    "Play",
    "To the start",
    "One sample back",
    "Loop",
    "End flight",
    "KNOCK IT OFF",
    "ABORT",
)
LIMITS = {"name": "envelope", "cases": [{"name": "any", "limits": {"Ny": 0.4}}]}


def test_each_role_sees_all_and_is_offered_what_it_may_do_and_no_more(
    own_page: Page, tmp_path: Path, allowed_errors: list[str]
) -> None:
    page = own_page
    allowed_errors += ["403 (Forbidden)", "404 (Not Found)"]  # the monitor has no evaluation
    with open_site(tmp_path, token=TOKEN) as site:
        dataset = collect(DatasetRecipe(n_unsafe=40, n_obs=10, seed=3))
        monitor = site.store.monitors.add(train(dataset, MonitorRecipe()), "doublet").id
        source = {"kind": "simulated", "seed": 7, "outcome": "unsafe"}
        api = f"{site.http}/api/v1"
        flights = f"{api}/flights"
        started = httpx2.post(flights, headers=OWN, json={"source": source, "monitor": monitor})
        flight = started.raise_for_status().json()["id"]
        httpx2.post(f"{api}/limit-sets", headers=OWN, json=LIMITS).raise_for_status()
        ends = {"slow": [None, 0.8], "fast": [0.8, None]}
        cases = [
            {"name": name, "monitor": monitor, "ranges": {"mach": mach}}
            for name, mach in ends.items()
        ]
        made = {"name": "both", "cases": cases}
        answer = httpx2.post(f"{api}/monitor-sets", headers=OWN, json=made)
        monitor_set = answer.raise_for_status().json()["id"]
        steer = f"{flights}/{flight}/transport"
        for action in ("pause", "next_alert"):
            httpx2.post(steer, headers=OWN, json={"action": action}).raise_for_status()
        tokens = site.store.tokens

        def log_in(name: str, role: Role) -> str:
            token, _ = tokens.add(name, role)
            page.goto(f"{site.http}/login?link={tokens.make_link(token.id)}")
            page.goto(f"{site.http}/#/fly/{flight}")
            expect(page.locator("#me")).to_have_text(f"{name} · {role}")
            page.locator('[data-flight="open"]').wait_for()
            expect(page.locator(".alarm-banner")).to_contain_text("ALERT")
            return token.id

        def button(name: str) -> Locator:
            return page.get_by_role("button", name=name)

        def offers_flights(is_offered: bool) -> None:
            for path, shown, names in (
                ("monitors", "Validity", ["Fly"]),
                (f"monitors/{monitor}", "Download", ["Fly"]),
                (f"sets/{monitor_set}", "All monitor sets", ["Fly it"]),
                ("fly/check", "Print", ["Store the result", "Start a flight", "Start the drill"]),
            ):
                page.goto(f"{site.http}/#/{path}")
                page.locator("main").get_by_text(shown, exact=True).first.wait_for()
                for name in names:
                    offered = page.locator("main .button").get_by_text(name, exact=True)
                    expect(offered).to_be_visible(visible=is_offered)
            page.goto(f"{site.http}/#/fly/{flight}")
            page.locator('[data-flight="open"]').wait_for()

        vi = log_in("Vi", "viewer")
        page.goto(f"{site.http}/#/monitors/new")
        expect(page.locator(".state-error")).to_contain_text("You are logged in as viewer")
        page.goto(f"{site.http}/#/sets")
        expect(page.locator('.nav [aria-current="page"]')).to_have_text("Monitors")
        page.goto(f"{site.http}/#/monitors")
        expect(page.get_by_role("link", name="Monitor sets")).to_be_visible()
        expect(page.get_by_role("link", name="Train a monitor")).to_be_hidden()
        offers_flights(False)
        for name in (*CONTROLS, "Acknowledge", "Change limits", "Note here"):
            expect(button(name)).to_have_count(0)
        expect(page.get_by_role("slider")).to_have_count(0)
        refused = "This needs the role operator; you are logged in as viewer."
        page.keyboard.press("k")
        expect(page.locator(".alarm-panel .error")).to_have_text(f"Not acknowledged. {refused}")
        page.keyboard.press("x")
        expect(page.get_by_text(f"ABORT WAS NOT SET. {refused} Call it by voice.")).to_be_visible()
        page.keyboard.press("n")
        page.get_by_role("button", name="Keys").click()
        keys = page.locator("dialog.shortcuts")
        expect(keys).to_contain_text("this list")
        expect(keys).not_to_contain_text("play or pause")
        expect(keys).not_to_contain_text("acknowledge")
        (alarm, *_) = httpx2.get(f"{flights}/{flight}/alarms", headers=OWN).json()
        assert alarm["by"] is None
        tokens.revoke(vi)
        expect(page.locator(".link-lost")).to_contain_text("The login has expired")
        expect(page.locator('[data-item="state"] .status-value')).to_contain_text("STALE")
        expect(page.locator('[data-item="record"] .status-value')).to_have_text("–")
        expect(page.locator(".gauge-number")).to_have_text("")
        expect(page.locator(".alarm-panel")).not_to_contain_text("No unacknowledged alarms")
        allowed_errors.extend(["401 (Unauthorized)", "WebSocket connection to"])

        log_in("Op", "operator")
        for name in CONTROLS:
            expect(button(name)).to_be_enabled()
        expect(button("Change limits")).to_have_count(0)
        page.keyboard.press("k")
        expect(page.locator(".event", has_text="acknowledged by Op").first).to_be_visible()
        offers_flights(True)

        log_in("Eng", "engineer")
        for name in (*CONTROLS, "Change limits"):
            expect(button(name)).to_be_enabled()
        httpx2.post(f"{flights}/{flight}/end", headers=OWN).raise_for_status()
        expect(button("Delete the record")).to_be_visible()
        page.goto("about:blank")


def test_an_admin_finds_people_and_the_audit_of_one_of_them(
    own_page: Page, tmp_path: Path, allowed_errors: list[str]
) -> None:
    page = own_page
    allowed_errors.append("403 (Forbidden)")
    with open_site(tmp_path, token=TOKEN) as site:
        tokens = site.store.tokens
        people: tuple[tuple[str, Role], ...] = ("Ada", "admin"), ("Vi", "viewer")
        for name, role in people:
            secret = tokens.add(name, role)[0]
            page.goto(f"{site.http}/login?link={tokens.make_link(secret.id)}")
            page.goto(f"{site.http}/#/people")
            expect(page.locator("#me")).to_have_text(f"{name} · {role}")
            link = page.get_by_role("link", name="People", exact=True)
            if name == "Vi":
                expect(link).to_be_hidden()
                expect(page.locator(".state-error")).to_contain_text("needs the role admin")
                expect(page.get_by_role("button", name="Try again")).to_have_count(0)
                break
            expect(link).to_be_visible()
            expect(page.locator("tr", has_text="Ada").first).to_contain_text("admin")
            audit = page.get_by_role("region", name="Audit lines")
            expect(audit.locator("tbody tr").first).to_contain_text("/login")
            page.get_by_label("Person").fill("Bob")
            page.get_by_label("Person").press("Enter")
            expect(audit).to_contain_text("No line in this period")
        page.goto("about:blank")
