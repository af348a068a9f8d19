"""Makes the recorded demonstration: `python -m tests.support.demonstration_recording`.

Trains the demonstration's monitor, flies one failing flight through it on a scripted clock, and
writes what a page that watches it is sent. The same program writes the same file.
"""

import json
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
from core.monitor import Monitor
from core.monitor.status import Facts, headline
from tests.support.flying import ScriptedClock, Seen, SilentRecorder

FILE = Path(__file__).parents[2] / "static" / "js" / "start" / "recording.json"
SOURCE = Simulated(kind="simulated", seed=2, outcome="unsafe")
"""Alerted on 0.45 s before it exceeds its limit."""
TITLE, MODE = "Demonstration", "demonstration recording"
DIGITS = 6
TICK_S = 0.01
PLAYED = ("hello", "frames", "heartbeat", "transport", "status")
"""Messages that the page makes itself, by its own clock."""
WHOLE = ("t", "y", "p_value", "alert", "state", "y_hat")
SPARSE = ("reason", "cause", "ahead")


def main() -> None:
    """Write the recording and print its size."""
    dataset = training.simulate(DATASET, print)
    monitor = training.train_and_test(dataset, MONITOR, N_TEST, print).monitor
    text = json.dumps(rounded(record(monitor)), separators=(",", ":"))
    FILE.write_text(text + "\n")
    print(f"written: {FILE}, {len(text) / 1000:.0f} kB")


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
        facts, verdict = flight.facts, flight.verdict
        pair = [plain(each, verdict) for each in (facts, facts._replace(alarm=False))]
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


def plain(facts: Facts, verdict: Verdict | None) -> dict[str, Any]:
    """The message of a status, without its type."""
    change = StatusChange(**headline(facts)._asdict(), verdict=verdict)
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
