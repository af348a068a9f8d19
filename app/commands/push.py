"""The command that pushes a recording into a live flight, as its source did in flight."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.commands.options.condition import add_condition, declared_of
from app.commands.options.option import add_json, option
from app.commands.output.results import print_result
from core.conditions import CONDITIONS, ConditionKey

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.client import LiveClient
    from app.commands.recorded_rows import RecordedRows

INTERRUPTED = 130
TOKEN = "FOREWARN_TOKEN"
FASTEST = "max"
LAST_S = 2.0
"""Longest wait of an interrupted push for acknowledgements."""
NOT_AS_FLOWN = (
    "not sent at the recorded rate: a warning is timed by the clock, so the flight's verdict on it "
    "is not that of the real flight; use --rate 1x for that"
)


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "file FILE", "telemetry in any supported format", type=Path)
    add_flight(parser)
    option(parser, "--rate 1x|4x|...|max", "multiple of the recorded rate", default="1x")
    option(parser, "--token TOKEN", f"an operator's token; default: {TOKEN}")
    option(parser, "--mapping FILE.json", "mapping of the signals", type=Path)
    option(
        parser,
        "--keep-open",
        "do not end the flight, given or started, once every sample is durable",
    )
    add_json(parser)


def add_flight(parser: argparse.ArgumentParser) -> None:
    """Options of a flight in progress, or of one to start."""
    into = parser.add_mutually_exclusive_group(required=True)
    option(into, "--flight ID", "flight in progress; its id ends the address of its page")
    option(
        into,
        "--monitor ID",
        "start a live flight with this monitor; its id ends the address of its page (Monitors), "
        "and is in GET /monitors",
    )
    option(into, "--monitor-set ID", "start a live flight with this monitor set")
    option(parser, "--server URL", "default: %(default)s", default="http://127.0.0.1:8000")
    option(parser, "--name NAME", "of the started flight")
    add_condition(parser)


def start_flight(
    client: LiveClient,
    options: argparse.Namespace,
    name: str | None,
    declared: dict[ConditionKey, float],
) -> None:
    """Start the flight of these options. PushFailed."""
    about = {"monitor_set": options.monitor_set, "condition": declared, "name": name}
    client.start(options.monitor, **about, recording=getattr(options, "recording", None))


def run(options: argparse.Namespace) -> int:
    """Push the file. Returns 0 only if every sample is durable."""
    from app.client import LiveClient, PushFailed  # slow to import, not needed for help

    rate = _rate(options.rate)
    client = LiveClient(options.server, options.token or os.environ.get(TOKEN))
    rows = _prepared(client, options)
    for note in (*rows.notes, *([NOT_AS_FLOWN] if rate != 1.0 else [])):
        print(note, file=sys.stderr)
    print(f"pushing into {client.address}", file=sys.stderr if options.json else sys.stdout)
    sys.stdout.flush()
    began, is_interrupted, failure = time.monotonic(), False, ""
    try:
        _push(client, rows, rate)
        is_void = not options.flight and client.refused == len(rows.t)
        if not options.keep_open and (is_void or client.durable == len(rows.t)):
            client.end()
    except KeyboardInterrupt:
        is_interrupted = True
        with suppress(PushFailed, KeyboardInterrupt):
            client.flush(LAST_S)
    except OSError as error:
        failure = str(error)
        print(f"forewarn: {failure}", file=sys.stderr)
    finally:
        client.close()
    counted = ("flight", "address", "sent", "durable", "refused", "refusal", "broken")
    pushed = {name: getattr(client, name) for name in counted} | {
        "samples": len(rows.t),
        "seconds": round(time.monotonic() - began, 3),
        "interrupted": is_interrupted,
        "failure": failure,
    }
    print_result(options, "\n".join(_lines(pushed, client.problem)), pushed)
    if is_interrupted:
        return INTERRUPTED
    return 0 if client.durable == len(rows.t) and not failure else 1


def _prepared(client: LiveClient, options: argparse.Namespace) -> RecordedRows:
    """Join or start the flight. Returns what to send. TelemetryError; PushFailed; ValueError."""
    from app.commands.recorded_rows import si_rows  # slow to import
    from core.channels import Dictionary

    declared = declared_of(options)
    flight, cases = {}, [{"monitor": options.monitor, "ranges": {}}]
    if options.flight:
        flight = client.flight_status(options.flight)
        if flown := flight["monitor_set"]:
            cases = flown["conditions"]
        client.join(options.flight)
        needed = {each["key"]: each["name"] for each in client.status()["conditions"]}
    else:
        if options.monitor_set:
            cases = client.monitor_set(options.monitor_set)["cases"]
        needed = {key: key for case in cases for key in case["ranges"] if key not in declared}
    monitor = flight.get("monitor") or cases[0]["monitor"]
    dictionary = Dictionary.from_stored(client.dictionary(monitor))
    if flight.get("source", {}).get("recording"):
        raise ValueError(
            f"flight {options.flight} reads the names of a recording, not SI units: push into a "
            "flight without one"
        )
    rows = si_rows(options.file, options.mapping, dictionary, needed)
    if lacking := [key for key, name in needed.items() if name not in rows.names]:
        labels = " and ".join(CONDITIONS[key].label for key in lacking)
        text = f"{labels}, of which {options.file} has no signal"
        if not options.flight:
            raise ValueError(
                f"the monitor set needs {text}: declare it with --condition "
                f"{lacking[0]}=VALUE, or map a signal to it with --mapping"
            )
        rows.notes.append(f"WARNING: the flight needs {text}")
    if not options.flight:
        start_flight(client, options, options.name, declared)
    return rows


def _rate(text: str) -> float:
    """Multiple of the recorded rate; infinite for `max`."""
    if text == FASTEST:
        return float("inf")
    with suppress(ValueError):
        if 0.0 < (rate := float(text.removesuffix("x"))) < float("inf"):
            return rate
    raise ValueError(f"--rate {text!r}: write 1x, 4x, ... or {FASTEST}")


def _push(client: LiveClient, rows: RecordedRows, rate: float) -> None:
    """Send each sample when it is due, then wait until all are durable."""
    begun, problem = time.monotonic(), ""
    times = rows.t.tolist()
    for t, row in zip(times, rows.values.tolist(), strict=True):
        due = begun + (t - times[0]) / rate
        if (wait := due - time.monotonic()) > 0.0:
            time.sleep(wait)
        client.send(dict(zip(rows.names, row, strict=True)))
        if client.problem != problem:
            problem = client.problem
            print(f"forewarn: {problem or 'samples are accepted again'}", file=sys.stderr)
    client.flush()


def _lines(pushed: dict[str, Any], problem: str) -> Iterator[str]:
    n, sent, durable, refused = (pushed[k] for k in ("samples", "sent", "durable", "refused"))
    if pushed["interrupted"]:
        yield f"interrupted: {sent} of {n} samples were sent"
    yield f"durable: {durable} of {n} samples, in {pushed['seconds']:.1f} s"
    if refused:
        yield f"refused: {refused}: {pushed['refusal']}"
    if pushed["broken"]:
        yield f"connections that broke: {pushed['broken']}"
    if problem:
        yield f"not acknowledged: {sent - durable - refused}: {problem}"
