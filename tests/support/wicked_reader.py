"""A reader that harms its process as the file says, for tests of its isolation."""

import ctypes
import os
import signal
import sys
from pathlib import Path

import numpy as np

from app.telemetry.contents import ColumnWriter, Contents
from app.telemetry.recording import TelemetryError

MAGIC = b"wicked "


def read(path: Path, writer: ColumnWriter) -> Contents:
    deed, _, argument = path.read_text().removeprefix(MAGIC.decode()).partition(" ")
    signal = writer.add_signal(writer.add_group(), "beta")
    writer.append(signal, np.zeros(1000))
    print("what a C library prints")
    print("what a C library prints", file=sys.stderr)
    if argument:
        Path(argument).write_text(str(os.getpid()))
    DEEDS[deed]()
    return writer.finish("wicked")


def crash() -> None:
    ctypes.string_at(0)


def loop() -> None:
    while True:
        pass


def burn() -> None:
    """Loop without the alarm, which a library may take for itself: that of CPU time is left."""
    signal.setitimer(signal.ITIMER_REAL, 0)
    loop()


def hold() -> None:
    """Wait without the alarm: neither limit of the system's is left."""
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.pause()


def eat() -> None:
    eaten = []
    while True:
        eaten.append(np.ones(2**18))


def eat_at_once() -> None:
    np.ones(2**42)


def fall() -> None:
    fall()


def lack() -> None:
    import no_such_library  # pyright: ignore[reportMissingImports]  # noqa: F401


def fill() -> None:
    raise OSError(28, "No space left on device")


def refuse() -> None:
    raise TelemetryError("this is wicked: be good")


def stumble() -> None:
    raise KeyError("\N{GREEK SMALL LETTER BETA}\udcff" * 10_000)


DEEDS = {
    "crash": crash,
    "loop": loop,
    "burn": burn,
    "hold": hold,
    "die": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "eat": eat,
    "eat_at_once": eat_at_once,
    "fall": fall,
    "exit": lambda: os._exit(7),
    "leave": lambda: sys.exit("bye"),
    "abort": os.abort,
    "lack": lack,
    "fill": fill,
    "refuse": refuse,
    "stumble": stumble,
    "nothing": lambda: None,
}
