"""The plugin for Open MCT, on a page of another origin: against a stub, and in Open MCT itself."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import httpx2
import pytest
from playwright.sync_api import Page, expect

from core.limits.limit_sets import LimitCase, LimitSet
from core.limits.limits import Limits
from tests.browser.chromium import wait_until
from tests.browser.fly.test_fly_page import CUT_OFF, EPSILON, UNSAFE, open_monitored_site
from tests.browser.fly.test_live import batch
from tests.browser.site import Site
from tests.support.patience import until

TOKEN = "a-token-of-the-control-room"
STUB = """<!doctype html><title>stub</title><script type="module">
const nothing = () => {};
const providers = window.mct = { types: [], formats: new Map() };
const indicator = { text: nothing, description: nothing, statusClass: nothing, iconClass: nothing };
window.openmct = {
  on: nothing,
  indicators: { simpleIndicator: () => indicator, add: nothing },
  types: { addType: (key) => providers.types.push(key), listKeys: () => providers.types },
  objects: {
    addRoot: (id) => (providers.root = id),
    addProvider: (_, it) => (providers.objects = it),
  },
  composition: { addProvider: (it) => (providers.composition = it) },
  telemetry: {
    addProvider: (it) => (providers.telemetry = it),
    getFormatter: (key) => providers.formats.get(key),
    addFormat: (it) => providers.formats.set(it.key, it),
  },
};
const plugin = await import("SERVER/openmct/forewarn.js");
plugin.Forewarn({ url: "SERVER", token: "TOKEN" })(openmct);
mct.plugin = plugin;
mct.point = (key) => mct.objects.get({ namespace: "forewarn", key });
mct.request = async (key, options = {}) => mct.telemetry.request(await mct.point(key), options);
mct.heard = {};
mct.listen = async (key) => {
  const heard = (mct.heard[key] = { data: [], stale: [] });
  const point = await mct.point(key);
  const off = [
    mct.telemetry.subscribe(point, (data) => heard.data.push(...data)),
    mct.telemetry.subscribeToStaleness(point, (answer) => heard.stale.push(answer)),
  ];
  heard.off = () => off.forEach((end) => end());
};
window.isReady = true;
</script>"""
OPEN_MCT = """<!doctype html><meta charset="utf-8"><title>Open MCT</title><div id="app"></div>
<script src="/node_modules/openmct/dist/openmct.js"></script><script type="module">
const { Forewarn } = await import("SERVER/openmct/forewarn.js");
const { LocalStorage, Espresso, UTCTimeSystem, LADTable, Conductor } = openmct.plugins;
const clockOffsets = { start: -600_000, end: 5_000 };
const menuOptions = [{ name: "Realtime", timeSystem: "utc", clock: "local", clockOffsets }];
openmct.setAssetPath("/node_modules/openmct/dist");
openmct.install(LocalStorage());
openmct.install(Espresso());
openmct.install(UTCTimeSystem());
openmct.install(LADTable());
openmct.install(Conductor({ menuOptions }));
openmct.install(Forewarn({ url: "SERVER", token: "TOKEN" }));
openmct.time.setClock("local", clockOffsets);
openmct.start();
</script>"""


HISTORY = """async (key) => {
  const point = await openmct.objects.get({ namespace: "forewarn", key });
  const [end, strategy, size] = [Date.now(), "minmax", 1000];
  const options = { start: end - 600_000, end: end + 60_000, strategy, size };
  const data = await openmct.telemetry.request(point, options);
  const { evaluate } = openmct.telemetry.limitEvaluator(point);
  return data.map((datum) => [datum.value, evaluate(datum)?.name ?? ""]);
}"""
"""Value and violated limit of each datum; a flight that jumped ahead is ahead of the clock."""


class Range(NamedTuple):
    """A server of Forewarn with the token of a viewer, and a folder that another origin serves."""

    site: Site
    folder: Path
    origin: str
    viewer: str

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        bearer = {"Authorization": f"Bearer {TOKEN}"}
        address = f"{self.site.http}/api/v1{path}"
        answer = httpx2.request(method, address, json=body, headers=bearer, timeout=60)
        assert answer.is_success, answer.text
        return answer.json()

    def fly(self, source: dict[str, Any]) -> str:
        monitor = self.ask("GET", "/monitors")[0]["id"]
        order = {"source": source, "monitor": monitor, "epsilon": EPSILON}
        return self.ask("POST", "/flights", order)["id"]

    def flown(self) -> str:
        """A failing flight that has ended."""
        flight = self.fly(UNSAFE)
        path = f"/flights/{flight}"
        until(lambda: not self.ask("GET", path)["transport"]["playing"])
        self.ask("POST", f"{path}/end", {})
        return flight

    def open(self, page: Page, html: str, path: str = "/") -> None:
        """html: with SERVER and TOKEN, which becomes that of a viewer."""
        text = html.replace("SERVER", self.site.http).replace("TOKEN", self.viewer)
        (self.folder / "index.html").write_text(text)
        self.go(page, path)

    def go(self, page: Page, path: str) -> None:
        """Open MCT misses some changes of its address alone."""
        page.goto("about:blank")
        page.goto(self.origin + path)


class _Files(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The folder's files on a separate origin."""
    files = partial(_Files, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), files) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def range_(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Range]:
    folder, data = tmp_path_factory.mktemp("page"), tmp_path_factory.mktemp("data")
    with (
        served(folder) as origin,
        open_monitored_site(data, token=TOKEN, allowed_origins=(origin,)) as site,
    ):
        range_ = Range(site, folder, origin, "")
        made = range_.ask("POST", "/tokens", {"name": "Open MCT", "role": "viewer"})
        yield range_._replace(viewer=made["token"])


@pytest.fixture
def stub(own_page: Page, range_: Range) -> Page:
    """A page with the plugin, installed in a stub of Open MCT that keeps its providers."""
    range_.open(own_page, STUB)
    wait_until(own_page, "window.isReady")
    return own_page


def test_flights_are_folders_of_points(stub: Page, range_: Range) -> None:
    ended, flying = range_.flown(), range_.fly(UNSAFE)
    names = """async (key) => {
        const object = await mct.objects.get({ namespace: "forewarn", key });
        const children = await mct.composition.load(object);
        return Promise.all(children.map(async (id) => [id.key, (await mct.objects.get(id)).name]));
    }"""
    assert stub.evaluate("mct.root.key") == "flights"
    assert stub.evaluate(names, "flights") == [["running", "In progress"], ["ended", "Ended"]]
    assert [key for key, _ in stub.evaluate(names, "running")] == [f"flight-{flying}"]
    assert f"flight-{ended}" in [key for key, _ in stub.evaluate(names, "ended")]
    points = dict(stub.evaluate(names, f"flight-{ended}"))
    assert points[f"{ended}.risk"] == "Risk"
    assert points[f"{ended}.channel-3"] == "N_y lateral acceleration"
    range_.ask("POST", f"/flights/{flying}/end", {})


def test_history_is_the_record_in_the_interval_asked_for(stub: Page, range_: Range) -> None:
    flight = range_.flown()
    frames = range_.ask("GET", f"/flights/{flight}/assessments")["frames"]
    ask = "([key, options]) => mct.request(key, options)"
    beta = stub.evaluate(ask, [f"{flight}.channel-0", {}])
    degrees = 57.29577951308232
    assert [each["value"] for each in beta] == pytest.approx([f["y"][0] * degrees for f in frames])
    assert [each["t"] for each in beta] == [frame["t"] for frame in frames]
    risk = stub.evaluate(ask, [f"{flight}.risk", {}])
    known = [each["value"] for each in risk if not isinstance(each["value"], str)]
    assert known == [frame["p_value"] for frame in frames if frame["p_value"] is not None]
    assert [each["t"] for each in risk if each["level"] == "warning"] == [
        frame["t"] for frame in frames if frame["alert"]
    ]
    start, end = beta[20]["utc"], beta[-20]["utc"]
    within = {"start": start, "end": end}
    assert stub.evaluate(ask, [f"{flight}.channel-0", within]) == beta[20:-19]
    latest = within | {"strategy": "latest", "size": 1}
    assert stub.evaluate(ask, [f"{flight}.channel-0", latest]) == [beta[-20]]
    few = stub.evaluate(ask, [f"{flight}.risk", {"strategy": "minmax", "size": 10}])
    assert len(few) <= 10
    assert max(each["value"] for each in few[1:]) == max(known)


def test_an_interval_of_a_long_flight_is_read_where_it_is(stub: Page, range_: Range) -> None:
    flight = range_.fly({"kind": "live", "trim": "none"})
    for k in range(7):
        range_.ask("POST", f"/flights/{flight}/samples", batch(k, 1000 * k, 1000))
    zero = range_.ask("GET", f"/flights/{flight}")["live"]["time_zero"]
    ask = """async ([key, zero, ...seconds]) => {
        const [start, end] = seconds.map((t) => Date.parse(zero) + 1000 * t);
        const data = await mct.request(key, { start, end });
        const asked = performance.getEntriesByType("resource");
        const parts = asked.map(({ name }) => /first=(\\d+)&last=(\\d+)/.exec(name));
        const read = parts.filter((part) => part && Number(part[2]) > Number(part[1]));
        return [data.map(({ t }) => t), read.map((part) => Number(part[1]))];
    }"""
    times, read = stub.evaluate(ask, [f"{flight}.channel-0", zero, 199.99, 201.01])
    assert times == pytest.approx([200.0 + 0.05 * k for k in range(21)])
    assert read == [2000, 4000]
    range_.ask("POST", f"/flights/{flight}/end", {})


def test_live_values_are_those_of_the_record(stub: Page, range_: Range) -> None:
    flight = range_.fly({"kind": "live", "trim": "none"})
    key = f"{flight}.channel-3"
    samples = f"/flights/{flight}/samples"
    range_.ask("POST", samples, batch(0, 0, 40))
    stub.evaluate("(key) => mct.listen(key)", key)
    for k in range(1, 4):
        sent = batch(k, 30 + 10 * k, 10)
        sent["Ny"] = [0.3 * k] * 10
        range_.ask("POST", samples, sent)
    wait_until(stub, f"mct.heard['{key}'].data.some(({{ t }}) => t > 3.4)")
    heard = stub.evaluate(f"mct.heard['{key}'].data")
    record = stub.evaluate("(key) => mct.request(key)", key)
    numbers = [each for each in heard if not isinstance(each["value"], str)]
    assert [(e["t"], e["value"]) for e in numbers] == [
        (e["t"], e["value"]) for e in record if e["t"] >= numbers[0]["t"]
    ]
    assert [e["t"] for e in record if e["level"] == "warning"] == [e["t"] for e in record[-20:]]
    assert record[-1]["side"] == "upr"
    last = stub.evaluate("(key) => mct.request(key, { strategy: 'latest' })", f"{flight}.state")
    assert stub.evaluate("([{ value }]) => value", last) == 10  # EXCEEDING
    assert range_.ask("GET", f"/flights/{flight}")["watchers"] == 1
    stub.evaluate(f"mct.heard['{key}'].off()")
    until(lambda: range_.ask("GET", f"/flights/{flight}")["watchers"] == 0)
    range_.ask("POST", f"/flights/{flight}/end", {})


def test_the_newest_value_of_a_replay_that_jumps_back_is_the_last(
    stub: Page, range_: Range
) -> None:
    flight = range_.fly(UNSAFE)
    steer = partial(range_.ask, "POST", f"/flights/{flight}/transport")
    steer({"action": "pause"})
    steer({"action": "seek", "value": 2.0})
    key = f"{flight}.channel-0"
    stub.evaluate("(key) => mct.listen(key)", key)
    for t in (2.0, 1.0):
        steer({"action": "seek", "value": t})
        wait_until(stub, f"Math.abs(mct.heard['{key}'].data.at(-1)?.t - {t}) < 0.01")
    times = [each["utc"] for each in stub.evaluate(f"mct.heard['{key}'].data")]
    assert times[-1] == max(times)
    range_.ask("POST", f"/flights/{flight}/end", {})


def test_no_number_is_left_when_samples_or_the_server_stop(
    stub: Page, range_: Range, allowed_errors: list[str]
) -> None:
    allowed_errors += [*CUT_OFF, "404"]
    flight = range_.fly({"kind": "live", "trim": "none"})
    range_.ask("POST", f"/flights/{flight}/samples", batch(0, 0, 40))
    keys = [f"{flight}.{name}" for name in ("risk", "channel-0", "age")]
    stub.evaluate("(keys) => Promise.all(keys.map(mct.listen))", keys)
    newest = f"({{ key }}) => mct.heard[`{flight}.${{key}}`].data.at(-1)?.value"
    for key in ("risk", "channel-0"):
        wait_until(stub, f"({newest})({{ key: '{key}' }}) === 'STALE'")
    wait_until(stub, f"({newest})({{ key: 'age' }}) > 1")
    is_stale = f"mct.heard['{flight}.risk'].stale.at(-1).isStale"
    assert stub.evaluate(is_stale)
    range_.ask("POST", f"/flights/{flight}/samples", batch(1, 40))
    wait_until(stub, f"mct.heard['{flight}.channel-0'].data.some(({{ t }}) => t === 2)")
    assert stub.evaluate(f"({newest})({{ key: 'channel-0' }})") == "STALE"  # it came late
    range_.ask("POST", f"/flights/{flight}/samples", batch(2, 41, 200))
    wait_until(stub, f"!{is_stale}")
    wait_until(stub, f"typeof ({newest})({{ key: 'channel-0' }}) === 'number'")
    range_.site.stop()
    try:
        wait_until(stub, f"{is_stale}")
        for key in ("risk", "channel-0", "age"):
            wait_until(stub, f"({newest})({{ key: '{key}' }}) === 'STALE'")
    finally:
        range_.site.start_again()
    stamps = stub.evaluate(f"mct.heard['{flight}.risk'].stale.map(({{ utc }}) => utc)")
    assert stamps == sorted(set(stamps))  # Open MCT takes only later ones
    wait_until(stub, f"({newest})({{ key: 'age' }}) !== 'STALE'", 60)
    range_.ask("POST", f"/flights/{flight}/end", {})
    wait_until(stub, f"({newest})({{ key: 'risk' }}) === 'ENDED'")
    assert stub.evaluate(is_stale)
    stub.evaluate("Object.values(mct.heard).forEach(({ off }) => off())")


def test_limits_put_in_force_in_flight_count_from_then_on(stub: Page, range_: Range) -> None:
    flight = range_.fly(UNSAFE)
    for action, value in (("pause", None), ("seek", 1.0)):
        range_.ask("POST", f"/flights/{flight}/transport", {"action": action, "value": value})
    key = f"{flight}.channel-3"
    stub.evaluate("(key) => mct.listen(key)", key)
    stub.evaluate(
        """async (key) => {
          mct.limits = [];
          const point = await mct.point(key);
          const { limits } = mct.telemetry.getLimits(point);
          mct.limits.push(await limits());
          mct.telemetry.subscribeToLimits(point, (changed) => mct.limits.push(changed));
        }""",
        key,
    )
    (before,) = stub.evaluate("mct.limits.slice(0, 1)")
    assert before["CRITICAL"]["high"] == {"color": "red", "value": 0.5}
    wait_until(stub, f"mct.heard['{key}'].stale.some(({{ isStale }}) => !isStale)")
    cases = (LimitCase("all", {}, Limits(Ny=0.001)),)
    made = range_.site.store.limit_sets.add("envelope", LimitSet(cases), "Ann")
    range_.ask("PUT", f"/flights/{flight}/limits", {"limit_set": made.limit_set})
    wait_until(stub, "mct.limits.at(-1).CRITICAL.high.value === 0.001")
    range_.ask("POST", f"/flights/{flight}/transport", {"action": "play"})
    wait_until(stub, f"mct.heard['{key}'].data.some(({{ level }}) => level === 'warning')")
    record = stub.evaluate("(key) => mct.request(key)", key)
    later = [each for each in record if each["level"] == "warning"]
    assert min(each["t"] for each in later) > 1.0
    assert min(abs(each["value"]) for each in later) < 0.5
    range_.ask("POST", f"/flights/{flight}/end", {})


def test_the_end_of_a_limit_counts_and_unknown_limits_have_none(stub: Page) -> None:
    points = """([t, Ny]) => {
        const held = [{ t: null, limits: { Ny: 0.5 } }, { t: 2, limits: null }];
        const channels = [{ key: "Ny", display_factor: 1 }];
        const flight = { held, channels, mode: "live", validity: "checked", own: { Ny: 9 } };
        const points = mct.plugin.pointsOf(flight);
        const frame = { t, y: [Ny], state: "ok", alert: false, p_value: 0.05 };
        return ["state", "channel-0"].map((name) => {
          const { of, states } = points.find(({ key }) => key === name);
          const { value, level, side } = of(frame);
          return states ? [states[value], level] : [value, level, side];
        });
    }"""
    for t, value, *shown in (
        (1.9, 0.49, ["OK", "none"], [0.49, "none", ""]),
        (1.9, 0.5, ["EXCEEDING", "warning"], [0.5, "warning", "upr"]),
        (1.9, -0.5, ["EXCEEDING", "warning"], [-0.5, "warning", "lwr"]),
        (2.0, 0.5, ["OK", "none"], [0.5, "none", ""]),
    ):
        assert stub.evaluate(points, [t, value]) == shown


@pytest.fixture(scope="module")
def with_open_mct(range_: Range) -> Range:
    """The range's page with Open MCT from the npm registry."""
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    install = ["npm", "install", "--prefix", str(range_.folder), "--no-audit", "--no-fund"]
    got = subprocess.run([*install, "openmct@4"], capture_output=True, text=True, check=False)
    if got.returncode != 0:
        pytest.skip(f"npm cannot install openmct: {got.stderr.strip().splitlines()[-1]}")
    return range_


def row(page: Page, name: str) -> Any:
    """The value of a point in Open MCT's table of newest values."""
    cells = page.locator("tr.js-lad-table__body__row", has_text=re.compile(f"^{name}"))
    return cells.locator(".js-third-data")


@pytest.mark.services
def test_open_mct_shows_a_flight_its_limits_and_its_staleness(
    own_page: Page, with_open_mct: Range, allowed_errors: list[str]
) -> None:
    page, range_ = own_page, with_open_mct
    allowed_errors += [*CUT_OFF, "404", "GPU stall", "AbortError"]  # Open MCT's, of a view left
    flight = range_.fly(UNSAFE)
    for action in ("pause", "next_alert"):
        range_.ask("POST", f"/flights/{flight}/transport", {"action": action})
    path = f"/#/browse/forewarn:flights/forewarn:running/forewarn:flight-{flight}"
    range_.open(page, OPEN_MCT, path)
    expect(row(page, "Risk")).to_have_text(re.compile(r"0\.\d{3}"))
    for name, words in (("State", "ALERT"), ("Headline", "ALARM"), ("Alarms", r"RISK: 0\.\d{3}")):
        expect(row(page, name)).to_have_text(re.compile(words))
    for name in ("Risk", "State", "Headline", "Alarms"):
        expect(row(page, name)).to_have_class(re.compile("is-limit--red"))
    expect(row(page, "N_y")).not_to_have_class(re.compile("is-limit"))
    range_.go(page, f"{path}/forewarn:{flight}.alarms")
    expect(page.locator(".c-telemetry-table tr.is-limit--red")).to_have_count(1)
    range_.go(page, f"{path}/forewarn:{flight}.risk")
    expect(page.locator(".gl-plot canvas").first).to_be_visible()
    history = page.evaluate(HISTORY, f"{flight}.risk")
    assert [limit for _, limit in history if limit] == ["CRITICAL"]
    assert history[-1][0] > EPSILON
    range_.go(page, path)
    expect(row(page, "Risk")).to_have_text(re.compile(r"0\.\d{3}"))
    expect(row(page, "Risk")).not_to_have_class(re.compile("is-stale"))
    range_.site.stop()
    try:
        for name in ("Risk", "State", "Headline", "N_y"):
            expect(row(page, name)).to_have_text("STALE")
            expect(row(page, name)).to_have_class(re.compile("is-stale"))
    finally:
        range_.site.start_again()
