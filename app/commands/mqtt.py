"""The command that connects a live flight with an MQTT broker."""

from __future__ import annotations

import argparse
import asyncio
import os
import ssl
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from app.commands.options.condition import declared_of
from app.commands.options.option import option
from app.commands.push import TOKEN, add_flight, start_flight
from core.conditions import ConditionKey

if TYPE_CHECKING:  # slow to import, and not needed for help
    from app.client import LiveClient
    from app.client.mqtt_bridge import Broker

PASSWORD = "FOREWARN_MQTT_PASSWORD"
PORTS = {"mqtt": 1883, "mqtts": 8883}
LOCAL = ("127.0.0.1", "::1", "localhost")
STARTS_S, AGAIN_S = 5.0, 0.1
"""[s] A listed flight accepts samples after this time at the latest; how often it is asked."""


def add(parser: argparse.ArgumentParser) -> None:
    option(parser, "source SOURCE", "name of the source, in the topics PREFIX/SOURCE/...")
    option(
        parser,
        "--broker URL",
        "MQTT 5 broker, mqtt://host or mqtts://host for TLS; default: %(default)s",
        default="mqtt://127.0.0.1",
    )
    option(parser, "--prefix PREFIX", "of the topics; default: %(default)s", default="forewarn")
    option(parser, "--user NAME", f"user of the broker; the password is in {PASSWORD}")
    option(parser, "--ca FILE", "PEM file that certifies the broker, if not the system", type=Path)
    option(parser, "--certificate FILE", "PEM file that certifies this client", type=Path)
    option(parser, "--key FILE", "PEM file with the key of --certificate", type=Path)
    add_flight(parser)
    option(parser, "--recording ID", "stored recording whose mapping the started flight uses")
    parser.epilog = f"{TOKEN} holds an operator's token, if the server needs one."


def run(options: argparse.Namespace) -> int:
    """Connect until the flight has ended or another command takes it over. Returns 0 then."""
    broker, topic = broker_of(options), topic_of(options.prefix, options.source)
    from app.client.mqtt_bridge import MqttBridge, try_broker  # slow to import, not needed for help

    declared = declared_of(options)
    if options.flight is None:
        try_broker(broker, topic)  # a wrong broker starts no flight
    bridge = MqttBridge(broker, topic, options.server, os.environ.get(TOKEN), say)
    join_or_start(bridge.client, options, declared)
    say(f"{broker} {topic}/samples into {bridge.client.address}")
    say(asyncio.run(bridge.run()))
    return 0


def say(text: str) -> None:
    print(f"forewarn: {text}", file=sys.stderr, flush=True)


def join_or_start(
    client: LiveClient, options: argparse.Namespace, declared: dict[ConditionKey, float]
) -> None:
    """Join the given flight, or the one in progress of this name and monitor, or start it.

    Of flights that two commands of a source start at the same moment, the later one ends at once.
    """
    name = options.name or options.source
    flight = options.flight or first_flight(client, options, name)
    if flight is None:
        start_flight(client, options, name, declared)
        flight = first_flight(client, options, name)
        if flight in (None, client.flight):
            return
        client.end()
    if client.flight_status(flight)["source"]["kind"] == "live":
        join(client, flight)
    else:
        client.flight = flight


def first_flight(client: LiveClient, options: argparse.Namespace, name: str) -> str | None:
    """The live flight in progress of this name and monitor that began first; None without one."""
    wanted = options.monitor_set or options.monitor
    flights = [
        each["id"]
        for each in client.in_progress()
        if each["name"] == name
        and each["source"]["kind"] == "live"
        and wanted == (each["monitor_set"]["id"] if each["monitor_set"] else each["monitor"])
    ]
    return flights[-1] if flights else None  # the newest is listed first


def join(client: LiveClient, flight: str) -> None:
    """Join a flight, which another command may be starting. OSError."""
    end = time.monotonic() + STARTS_S
    while True:
        try:
            client.join(flight)
            return
        except OSError:
            if time.monotonic() > end:
                raise
        time.sleep(AGAIN_S)


def topic_of(prefix: str, source: str) -> str:
    """The topic that all others are below. ValueError."""
    for what, text in (("--prefix", prefix), ("SOURCE", source)):
        if not text or text != text.strip("/") or text.startswith("$") or set(text) & set("+#\0"):
            raise ValueError(
                f"{what} {text!r} is no part of a topic: give letters, digits, - and _, such as "
                "F16-7; a prefix may have parts, such as range/forewarn"
            )
    if "/" in source:
        raise ValueError(f"SOURCE {source!r} has parts: give those before the last by --prefix")
    return f"{prefix}/{source}"


def broker_of(options: argparse.Namespace) -> Broker:
    """The broker and the login of these options. ValueError; OSError for files."""
    url = urlsplit(options.broker)
    try:
        port = url.port
    except ValueError:
        port = 0
    if url.scheme not in PORTS or not url.hostname or url.path not in ("", "/") or port == 0:
        raise ValueError(
            f"--broker {options.broker!r}: give mqtt://host or mqtts://host, with :port if it is "
            f"not {PORTS['mqtt']} or {PORTS['mqtts']}"
        )
    if "@" in url.netloc:
        raise ValueError(
            f"--broker holds a login, which others of this machine can read: give --user, and the "
            f"password by {PASSWORD}"
        )
    password = os.environ.get(PASSWORD)
    if password and options.user is None:
        raise ValueError("a password of the broker needs its user: give --user")
    tls = None
    if url.scheme == "mqtts":
        tls = _tls(options)
    elif options.ca or options.certificate:
        raise ValueError("--ca and --certificate are for TLS: give --broker mqtts://...")
    elif password and url.hostname not in LOCAL:
        say(f"WARNING: the password goes to {url.hostname} unencrypted: use mqtts://")
    from app.client.mqtt_bridge import Broker  # slow to import, not needed for help

    return Broker(url.hostname, port or PORTS[url.scheme], options.user, password, tls)


def _tls(options: argparse.Namespace) -> ssl.SSLContext:
    for path in filter(None, (options.ca, options.certificate, options.key)):
        if not path.is_file():
            raise ValueError(f"{path} is no file: give a PEM file")
    try:
        context = ssl.create_default_context(cafile=options.ca)
        if options.certificate is not None:
            context.load_cert_chain(options.certificate, options.key)
    except ssl.SSLError as error:
        raise ValueError(
            f"--ca, --certificate and --key are no PEM files that belong together ({error})"
        ) from None
    return context
