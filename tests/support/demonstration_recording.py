"""Makes the recorded demonstration: `python -m tests.support.demonstration_recording`.

Trains the demonstration's monitor, flies one failing flight through it on a scripted clock, and
writes what a page that watches it is sent, its picture, and the flight as a recorder would have
written it. The same program writes the same files.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from app.demonstration import DATASET, MONITOR, N_TEST, NAME
from app.flights.flight import FlightPlan
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.replay import TrackFlight
from app.flights.sources.simulated import simulate
from app.flights.sources.source import Simulated
from app.jobs import training
from app.messages import StatusChange, Verdict
from core.channels import CHANNELS
from core.limits.exceedance import LatchedExceedance
from core.monitor import Monitor
from core.monitor.status import Facts, headline
from tests.support.flying import ScriptedClock, Seen, SilentRecorder

START = Path(__file__).parents[2] / "static" / "js" / "start"
FILE, PICTURE, EXAMPLE = (
    START / name for name in ("recording.json", "picture.svg", "example-flight.csv")
)
SOURCE = Simulated(kind="simulated", seed=2, outcome="unsafe")
"""Alerted on 0.8 s before it exceeds its limit."""
TITLE, MODE = "Demonstration", "demonstration recording"
DIGITS = 6
TICK_S = 0.01
PLAYED = ("hello", "frames", "heartbeat", "transport", "status")
"""Messages that the page makes itself, by its own clock."""
WHOLE = ("t", "y", "p_value", "alert", "state", "y_hat")
SPARSE = ("reason", "cause", "ahead")
WIDTH, HEIGHT, PAD = 640, 210, 8
"""Of the picture [px]."""
UNTIL_S = 3.0
"""End of the picture's time axis."""
TRIM_S = 5.0
"""Trim before the flight in the example."""
COLUMNS = "t_s,beta_deg,p_degps,r_degps,ay_g,da_deg,dr_deg"


def main() -> None:
    """Write the recording and print its size."""
    dataset = training.simulate(DATASET, print)
    monitor = training.train_and_test(dataset, MONITOR, N_TEST, print).monitor
    recording = rounded(record(monitor))
    FILE.write_text(json.dumps(recording, separators=(",", ":")) + "\n")
    PICTURE.write_text(picture(recording))
    EXAMPLE.write_text(example(recording))
    for file in (FILE, PICTURE, EXAMPLE):
        print(f"written: {file}, {file.stat().st_size / 1000:.0f} kB")


def record(monitor: Monitor) -> dict[str, Any]:
    """Fly the flight; returns what a page is sent, its frames by columns.

    headlines: at the samples where they change, with the alarms open and with them acknowledged.
    """
    clock = ScriptedClock()
    track = simulate(DATASET, SOURCE.seed, SOURCE.theta, SOURCE.outcome)
    epsilon = monitor.check_epsilon()
    source = SOURCE.model_dump(exclude_none=True)
    plan = FlightPlan(NAME, TITLE, source, monitor, NAME, NAME, epsilon, "simulated")
    script = AssessedTrack(track, monitor, epsilon)
    flight = TrackFlight(plan, script, SilentRecorder(clock), clock, lambda *_: None)
    watcher = Seen(flight.watch())
    (hello,) = watcher.take()
    flight.start()
    messages, headlines = [], []
    while True:
        for message in watcher.take():
            if message["type"] not in PLAYED:
                messages.append({"seq": flight.head, "message": message})
        facts, verdict, latched = flight.facts, flight.verdict, flight.exceedances.latched
        pair = [
            plain(facts, verdict, latched),
            plain(facts._replace(alarm=False), verdict, [each for each in latched if each.over]),
        ]
        if not headlines or headlines[-1]["pair"] != pair:
            headlines.append({"seq": flight.head, "pair": pair})
        if flight.head == len(track.t) - 1:
            break
        clock.advance(TICK_S)
    hello |= {"mode": MODE, "marker_kinds": []}
    return {
        "hello": hello,
        "messages": messages,
        "headlines": headlines,
        "frames": columns(watcher.frames),
    }


def picture(recording: Mapping[str, Any]) -> str:
    """The exceeded channel with its limit, the alert and the exceedance, as SVG."""
    hello, whole = recording["hello"], recording["frames"]["whole"]
    alarms = {
        m["message"]["alarm"]["kind"]: m["message"]["alarm"] for m in recording["messages"][1:]
    }
    alert, exceeded = alarms["risk"], alarms["limit"]
    value, key = exceeded["exceedance"]["value"], exceeded["exceedance"]["channel"]
    index = next(k for k, channel in enumerate(hello["channels"]) if channel["key"] == key)
    channel = hello["channels"][index]
    limit, values = channel["limit"], [sample[index] for sample in whole["y"]]
    most, side = 1.25 * max(limit, *map(abs, values)), 1 if value > 0 else -1

    def x(t: float) -> float:
        return PAD + t / UNTIL_S * (WIDTH - 2 * PAD)

    def y(value: float) -> float:
        return HEIGHT / 2 - value / most * (HEIGHT / 2 - PAD)

    def word(name: str, t: float, height: float, text: str, anchor: str = "start") -> str:
        place = f'x="{x(t):.1f}" y="{height:.1f}" text-anchor="{anchor}"'
        return f'<text class="picture-word-{name}" {place}>{text}</text>'

    points = zip(whole["t"], values, strict=True)
    trace = "L".join(f"{x(t):.1f} {y(v):.1f}" for t, v in points if t <= UNTIL_S)
    limits = "".join(f"M{PAD} {y(sign * limit):.1f}H{WIDTH - PAD}" for sign in (1, -1))
    at, wide = x(alert["t"]), x(exceeded["t"]) - x(alert["t"])
    parts = [
        f'<rect class="picture-lead" x="{at:.1f}" y="0" width="{wide:.1f}" height="{HEIGHT}"/>',
        f'<path class="picture-limit" d="{limits}"/>',
        f'<path class="picture-trace" d="M{trace}"/>',
        f'<path class="picture-alert" d="M{at:.1f} 0V{HEIGHT}"/>',
        f'<circle class="picture-exceeded" cx="{at + wide:.1f}" cy="{y(value):.1f}" r="6"/>',
        word("limit", 0.05, y(limit) - 7, f"limit {limit:g} {channel['display_unit']}"),
        word("alert", alert["t"] - 0.04, y(-0.72 * side * limit), "▲ alert", "end"),
        word(
            "exceeded", exceeded["t"] + 0.1, y(value) + (20 if side < 0 else -12), "limit exceeded"
        ),
    ]
    drawing = "\n".join(parts)
    box = f'class="picture" viewBox="0 0 {WIDTH} {HEIGHT}" aria-hidden="true"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {box}>\n{drawing}\n</svg>\n'


def example(recording: Mapping[str, Any]) -> str:
    """The flight after TRIM_S in trim, as CSV in the units of COLUMNS."""
    dt, y = recording["hello"]["dt"], recording["frames"]["whole"]["y"]
    factors = [channel.display_factor for channel in CHANNELS]

    def lines() -> Iterator[str]:
        yield COLUMNS
        for k, sample in enumerate([[0.0] * len(factors)] * round(TRIM_S / dt) + y):
            values = [k * dt, *(v * factor for v, factor in zip(sample, factors, strict=True))]
            yield ",".join(f"{value:.8g}" for value in values)

    return "\n".join(lines()) + "\n"


def plain(
    facts: Facts, verdict: Verdict | None, latched: list[LatchedExceedance]
) -> dict[str, Any]:
    """The message of a status, without its type."""
    change = StatusChange(**headline(facts)._asdict(), verdict=verdict, latched=latched)
    return change.model_dump(mode="json", exclude={"type"})


def columns(frames: list[dict[str, Any]]) -> dict[str, Any]:
    """Frames by columns; of what few frames have, [index, value]."""
    assert [frame["seq"] for frame in frames] == [*range(len(frames))]
    whole = {key: [frame[key] for frame in frames] for key in WHOLE}
    sparse = {
        key: [[k, frame[key]] for k, frame in enumerate(frames) if frame.get(key)] for key in SPARSE
    }
    return {"whole": whole, "sparse": sparse}


def rounded(given: Any) -> Any:
    """The same with floats of DIGITS significant digits."""
    if isinstance(given, dict):
        return {key: rounded(value) for key, value in given.items()}
    if isinstance(given, list):
        return [rounded(value) for value in given]
    return float(f"{given:.{DIGITS}g}") if isinstance(given, float) else given


if __name__ == "__main__":
    main()
