"""Makes the guide's pictures: our own pages in Chromium, and figures: `make pictures`."""

import io
import itertools
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from playwright.sync_api import Browser, Locator, Page

from app.commands.sample_flight import table
from app.main import STATIC
from app.recipes.recipes import to_plain
from core.channels import KEYS
from core.limits.limits import Limits
from core.monitor import Monitor, MonitorRecipe, load
from core.monitor.predictor import ResponseFilter
from core.monitor.score import CardWindow
from core.planned_test.collection import DatasetRecipe
from core.planned_test.planned_test import LateralSimulator
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.maneuver import Doublet
from tests.browser.chromium import open_chromium
from tests.browser.site import Site, open_site

PICTURES = STATIC / "guide" / "pictures"
COLOURS = 96
"""Of a picture's palette."""
WIDTH, HEIGHT = 1280, 760
DATASET = DatasetRecipe(n_unsafe=200, seed=1).as_flown()
MONITOR = MonitorRecipe(
    t_early=0.25, epsilon=0.1, guarantee="95%", predictor=ResponseFilter(), score=CardWindow()
)
OTHER_SIDE = DatasetRecipe(n_unsafe=20, maneuver=Doublet(amplitude_deg=-9.5), seed=2)
FLIGHT = {"kind": "simulated", "seed": 3, "outcome": "unsafe"}
BUILD_UP = DatasetRecipe(
    aircraft=PublishedAircraft("attas_id_16kft"),
    control_law=CONTROL_LAWS["none"],
    maneuver=Doublet(amplitude_deg=6.4, amplitude_jitter=0.1),
    specification=Limits(Ny=0.305),
    n_unsafe=60,
)
DT = DATASET.dt
CLEARLY_BEYOND = 0.55
"""[g] N_y of the recording shown."""
WELL_BEFORE = 8
"""Samples between the alert and the limit of the recording shown."""
SETTLE = 900
"""[ms] Until a page shows the newest sample."""


class Studio:
    """A server with something to show, and a browser that takes pictures of it."""

    def __init__(self, site: Site, browser: Browser) -> None:
        self.site, self.browser = site, browser
        self.http = httpx2.Client(base_url=site.http, timeout=300)
        self.page = self.open("light")

    def open(self, theme: str) -> Page:
        size: Any = {"width": WIDTH, "height": HEIGHT}
        context = self.browser.new_context(viewport=size, color_scheme=theme)  # pyright: ignore[reportArgumentType]
        return context.new_page()

    def ask(self, method: str, path: str, **given: Any) -> Any:
        """Call the REST interface; a job is waited for."""
        answer = self.http.request(method, f"/api/v1{path}", **given)
        assert answer.is_success, answer.text
        if answer.status_code != 202:
            return answer.json() if answer.content else None
        while (job := self.http.get(answer.headers["Location"]).json())["status"] in (
            "queued",
            "running",
        ):
            time.sleep(0.2)
        assert job["status"] == "done", job
        return job

    def go(self, view: str, page: Page | None = None) -> Page:
        page = page or self.page
        page.goto("about:blank")
        page.goto(f"{self.site.http}/#/{view}")
        page.wait_for_load_state("networkidle")
        page.wait_for_timeout(500)
        return page

    def fly(self, source: dict[str, Any], monitor: str, page: Page | None = None) -> str:
        """Start a flight, one that can be steered at its first sample, and open its page."""
        body = {"source": source, "monitor": monitor}
        flight = self.ask("POST", "/flights", json=body)["id"]
        if source["kind"] != "live":
            self.steer(flight, "pause")
        page = page or self.page
        page.goto("about:blank")
        page.goto(f"{self.site.http}/#/fly/{flight}")
        page.locator('[data-flight="open"]').wait_for()
        return flight

    def steer(self, flight: str, action: str, value: Any = None) -> None:
        body = {"action": action, "value": value}
        self.ask("POST", f"/flights/{flight}/transport", json=body)

    def step_until(
        self, flight: str, holds: Callable[[dict[str, Any]], bool], steps: bool = True
    ) -> dict[str, Any]:
        """The flight at its first sample of which something holds; a live one is waited for."""
        for _ in range(2000):
            if holds(state := self.ask("GET", f"/flights/{flight}")):
                return state
            self.steer(flight, "step", 1) if steps else time.sleep(0.02)
        raise ValueError(f"it never holds of flight {flight}")

    def end(self, flight: str) -> None:
        self.ask("POST", f"/flights/{flight}/end")


class Source:
    """A live source at rest that sends at its rate while the block lasts."""

    def __init__(self, studio: Studio, flight: str) -> None:
        self.studio, self.flight = studio, flight
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.send, daemon=True)

    def send(self) -> None:
        rest = dict.fromkeys(KEYS, 0.0)
        start = time.monotonic()
        for k in itertools.count():
            if self.over.wait(max(0.0, start + k * DT - time.monotonic())):
                return
            body = {"sequence": k, "t": k * DT} | rest
            self.studio.ask("POST", f"/flights/{self.flight}/samples", json=body)

    def __enter__(self) -> None:
        self.thread.start()

    def __exit__(self, *_: object) -> None:
        self.over.set()
        self.thread.join()


def save(name: str, picture: bytes) -> None:
    """Store a screenshot with a palette."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    method = Image.Quantize.MEDIANCUT
    image = image.quantize(COLOURS, method=method, dither=Image.Dither.NONE)
    image.save(PICTURES / f"{name}.png", optimize=True)
    print(name, (PICTURES / f"{name}.png").stat().st_size // 1000, "kB")


def take(name: str, what: Page | Locator) -> None:
    save(name, what.screenshot())


def gauges(studio: Studio, monitor: str, opposite: str) -> None:
    """The gauge in each state."""
    page = studio.page
    gauge = page.locator(".gauge-panel")
    flight = studio.fly(FLIGHT, monitor)
    studio.step_until(flight, lambda state: state["head"] >= 10)
    page.wait_for_timeout(SETTLE)
    take("gauge-ok", gauge)
    studio.end(flight)

    replay = {"kind": "replay", "dataset": opposite, "outcome": "safe", "rollout": 0}
    flight = studio.fly(replay, monitor)
    studio.step_until(flight, lambda state: "invalid" in (state["status"], *state["beside"]))
    page.wait_for_timeout(SETTLE)
    take("gauge-invalid", gauge)
    studio.end(flight)

    flight = studio.fly({"kind": "live"}, monitor)
    page.wait_for_timeout(SETTLE)
    take("live-waiting", page)
    with Source(studio, flight):
        page.wait_for_timeout(SETTLE)
    page.wait_for_timeout(2000)
    take("gauge-stale", gauge)
    studio.end(flight)


def alert(studio: Studio, monitor: str) -> None:
    """An alert in flight, and the record of the flight."""
    page = studio.page
    flight = studio.fly(FLIGHT, monitor)
    studio.step_until(flight, lambda state: state["open_alarms"])
    for _ in range(2):
        studio.steer(flight, "step", 1)
    page.wait_for_timeout(SETTLE)
    take("gauge-alert", page.locator(".gauge-panel"))
    take("alarm", page.locator(".alarm-banner"))
    take("strips-alert", page.locator(".strip-chart"))
    studio.step_until(flight, lambda state: state["exceeded_t"] is not None)
    studio.steer(flight, "play")
    page.wait_for_timeout(2500)
    studio.end(flight)
    studio.go(f"fly/{flight}")
    page.wait_for_timeout(SETTLE)
    take("record", page)


def heroes(studio: Studio, monitor: str) -> None:
    """The flight that README shows, in both themes."""
    for theme in ("light", "dark"):
        page = studio.open(theme)
        flight = studio.fly(FLIGHT, monitor, page)
        studio.step_until(flight, lambda state: state["exceeded_t"] is not None)
        page.wait_for_timeout(8000)  # the processor draws the scene
        take(f"fly-alert-{theme}", page)
        studio.end(flight)
        page.context.close()


def recordings(studio: Studio, monitor: str, trained: Monitor) -> None:
    """A recording of a flight that is warned of in time: its mapping, its scoring."""
    flights = LateralSimulator(DATASET).rollouts(30, np.random.default_rng(5))
    failing = next(
        y
        for y, fails in zip(flights.y, flights.fail_index, strict=True)
        if fails >= 0
        and np.abs(y[:, KEYS.index("Ny")]).max() > CLEARLY_BEYOND
        and trained.p_values(y)[: fails - WELL_BEFORE].max() > trained.alert_above()
    )
    text = table(failing, DT)
    recording = studio.ask(
        "POST", "/recordings", params={"name": "flight 12.csv"}, content=text.encode()
    )["id"]
    take("mapping", studio.go(f"recordings/{recording}"))
    mapping = studio.ask("GET", f"/recordings/{recording}")["mapping"]
    studio.ask("PUT", f"/recordings/{recording}/mapping", json={"mapping": mapping})
    scoring = studio.ask("POST", f"/recordings/{recording}/scorings", json={"monitor": monitor})[
        "id"
    ]
    take("scoring", studio.go(f"recordings/{recording}?scoring={scoring}"))
    take("storage", studio.go("storage"))


def limit_set(studio: Studio) -> None:
    cases = [
        {"name": "below M 0.8", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": 0.5}},
        {"name": "from M 0.8 on", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": 0.4}},
    ]
    made = studio.ask("POST", "/limit-sets", json={"name": "envelope", "cases": cases})
    take("limit-set", studio.go(f"limits/{made['limit_set']}"))


def campaign(studio: Studio) -> None:
    """A campaign with two flown points."""
    plan = {
        "name": "Rudder build-up",
        "conditions": [{"dataset": to_plain(BUILD_UP), "steps": [0.4, 0.6, 0.8, 1.0]}],
        "clearance": {"n_exceeding": 40, "n_aircraft": 100},
    }
    path = f"/campaigns/{studio.ask('POST', '/campaigns', json=plan)['id']}"
    test = BUILD_UP
    for point, step in (("40%", 0.4), ("60%", 0.6)):
        if step > 0.4:
            studio.ask("POST", f"{path}/clearance", json={"point": point, "by": "Ann"})
        studio.ask("POST", f"{path}/confirm", json={"point": point, "by": "Ann"})
        doublet = Doublet(amplitude_deg=6.4 * step)
        simulator = LateralSimulator(replace(test, maneuver=doublet))
        theta = simulator.plant.nominal[np.newaxis]
        y = simulator.fly(theta, np.random.default_rng(1))[0].y[0]
        text = table(y, test.dt)
        params = {"name": f"{point}.csv"}
        recording = studio.ask("POST", "/recordings", params=params, content=text.encode())["id"]
        mapping = studio.ask("GET", f"/recordings/{recording}")["mapping"]
        studio.ask("PUT", f"/recordings/{recording}/mapping", json={"mapping": mapping})
        body = {"point": point, "by": "Bob", "recording": recording}
        studio.ask("POST", f"{path}/flown", json=body)
    studio.ask("POST", f"{path}/clearance", json={"point": "80%", "by": "Ann"})
    take("campaign", studio.go(path[1:]))


def figure(name: str, width: float, height: float) -> Figure:
    """A figure with neutral colours on white, which both themes frame."""
    drawn = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    drawn.set_gid(name)
    return drawn


def write(name: str, drawn: Figure) -> None:
    with mpl.rc_context({"svg.hashsalt": name, "svg.fonttype": "path"}):
        drawn.savefig(PICTURES / f"{name}.svg", metadata={"Date": None})
    print(name, (PICTURES / f"{name}.svg").stat().st_size // 1000, "kB")


def lead_figure() -> None:
    """Lateral load factor with an alert, the latest useful alert and the limit."""
    drawn = figure("lead", 7.2, 3.0)
    axes = drawn.subplots()
    t = np.linspace(0, 3, 400)
    n_y = 0.62 * np.exp(-(((t - 2.35) / 0.75) ** 2))
    at = float(np.interp(0.5, n_y[t < 2.3], t[t < 2.3]))
    axes.plot(t, n_y, color="#00559c", linewidth=2)
    axes.axhline(0.5, color="#b3190f", linewidth=1.5)
    axes.text(0.02, 0.515, "limit 0.5 g", color="#b3190f")
    marks = (
        (at - 0.45, "alert ", "#8a5200", "right", 0.66),
        (at - 0.25, "latest alert in time ", "#555555", "right", 0.73),
        (at, " limit exceeded", "#b3190f", "left", 0.73),
    )
    for x, words, colour, side, height in marks:
        axes.axvline(x, color=colour, linestyle="--", linewidth=1)
        axes.text(x, height, words, color=colour, ha=side, va="top")
    for start, height, words in ((0.45, 0.14, "lead time 0.45 s"), (0.25, 0.05, "lead 0.25 s")):
        arrow = {"arrowstyle": "<->", "color": "#333333"}
        axes.annotate("", (at - start, height), (at, height), arrowprops=arrow)
        axes.text(at + 0.04, height, words, va="center")
    axes.set(xlabel="time [s]", ylabel="|N_y| [g]", ylim=(0, 0.75), xlim=(0, 3))
    axes.spines[["top", "right"]].set_visible(False)
    write("lead", drawn)


def calibration_figure(alphas: np.ndarray, epsilon: float) -> None:
    """Calibration scores of the failures, the dangerous to the left, and the threshold."""
    finite = np.sort(alphas[np.isfinite(alphas)])
    kept = finite[: int(np.ceil(len(finite) * 0.985))]
    rank = int(np.ceil((len(alphas) + 1) * (1 - epsilon)))
    threshold = finite[min(rank, len(finite)) - 1]
    drawn = figure("calibration", 7.2, 2.8)
    axes = drawn.subplots()
    bins = np.linspace(kept[0], kept[-1], 40)
    axes.hist(finite[finite <= threshold], bins, color="#4e83b5", label="alert in time")
    missed = f"missed: a share ε = {epsilon:g}"
    axes.hist(finite[finite > threshold], bins, color="#c9742b", hatch="//", label=missed)
    axes.axvline(threshold, color="#111111", linewidth=2, linestyle="--", label="threshold")
    axes.set(xlabel="calibration score (low: looks dangerous)", ylabel="failures")
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    write("calibration", drawn)


def alert_level_figure(epsilon: float, alert_above: float) -> None:
    """The scale of the risk, with both levels."""
    drawn = figure("alert-level", 7.2, 1.7)
    axes = drawn.subplots()
    top = 2 * epsilon
    axes.axhspan(0.25, 0.75, color="#eeeeee")
    axes.fill_between([alert_above, top], 0.25, 0.75, color="#f1c7c3")
    for x, words, y in (
        (epsilon, f"ε = {epsilon:g}: what is promised", 0.98),
        (alert_above, f"alert_above = {alert_above:.3g}: where the monitor alerts", -0.02),
    ):
        axes.plot([x, x], [0.15, 0.85], color="#111111", linewidth=2)
        axes.text(x, y, words, ha="center", va="center")
    axes.text(top * 0.995, 0.5, "alert", ha="right", va="center", color="#8a120a", weight="bold")
    axes.text(top * 0.005, 0.5, "no alert", va="center")
    axes.set(xlim=(0, top), ylim=(-0.2, 1.15), xlabel="risk", yticks=[])
    axes.spines[["top", "right", "left"]].set_visible(False)
    write("alert-level", drawn)


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        open_site(Path(folder)) as site,
        open_chromium() as browser,
    ):
        studio = Studio(site, browser)
        body = {"name": "F-16 rudder doublet", "dataset": to_plain(DATASET), "n_test": 2000}
        monitor = studio.ask("POST", "/monitors", json=body | to_plain(MONITOR))["result"]
        monitor = monitor["monitor"] if isinstance(monitor, dict) else monitor
        opposite = studio.ask("POST", "/datasets", json=to_plain(OTHER_SIDE))["result"]
        opposite = opposite["dataset"] if isinstance(opposite, dict) else opposite
        file = Path(folder) / "monitor.fwm"
        file.write_bytes(httpx2.get(f"{site.http}/api/v1/monitors/{monitor}/file").content)
        trained = load(file)
        lead_figure()
        calibration_figure(np.asarray(trained.alphas), MONITOR.epsilon)
        alert_level_figure(MONITOR.epsilon, trained.alert_above())
        take("monitor", studio.go(f"monitors/{monitor}"))
        gauges(studio, monitor, opposite)
        alert(studio, monitor)
        recordings(studio, monitor, trained)
        limit_set(studio)
        heroes(studio, monitor)
        campaign(studio)


if __name__ == "__main__":
    main()
