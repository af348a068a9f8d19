"""Rollouts as sent: files of flights or stored recordings, and the fields that describe them."""

from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from app.recordings.files import reporting_full_disk
from app.recordings.upload import SentField, plain_name, receive
from app.telemetry.limit_texts import rest_of
from app.telemetry.recording import TelemetryError
from app.telemetry.rollouts import (
    GivenDictionary,
    RolloutFile,
    dictionary_of_text,
    read_rollouts,
)
from core.computed import complete
from core.recipe import instead_of
from core.rollouts import UNLABELLED

MOST_FILES = 20_000
MOST_TEXT = 2**18
"""Most bytes of a field that is no file."""
LONGEST_NAME = 200
MOST_NAME_BYTES = 255
"""Longest file name on the usual file systems."""
FILES = "files"
"""Folder of the sent files, within that of the upload."""
TEXTS = (
    *("name", "dictionary", "channel", "limit", "dt"),
    *("recording", "label", "dataset"),
)
"""Fields that are no files."""
LISTS = {name: f"{name}s" for name in ("limit", "channel", "recording", "label")}
"""Fields with one value a line, or sent several times, and the attributes that they extend."""
SAFE = "safe"
"""Label of a recording without a failure."""


@dataclass
class SentRollouts:
    """Files of rollouts, received into a folder, or stored recordings and rollouts.

    name: of the dataset.   files: their names.   dictionary: None to make it from the files.
    channels, limits: as the command line writes them.   dt: [s], None if the files give it.
    recordings: ids of those whose manoeuvres are rollouts, or ID/SCORING for those of a scoring.
    labels: see `failures_of`.   dataset: id of stored rollouts to join, "" for none.
    n_bytes: of the files.
    """

    folder: Path
    name: str = ""
    files: list[str] = field(default_factory=list)
    dictionary: GivenDictionary | None = None
    channels: list[str] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    dt: float | None = None
    recordings: list[str] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    dataset: str = ""
    n_bytes: int = 0

    def set_field(self, name: str, text: str, file_name: str = "") -> None:
        """Set a text field. TelemetryError."""
        lines = [part for line in text.splitlines() if (part := line.strip())]
        if name in LISTS:
            getattr(self, LISTS[name]).extend(lines)
        elif name == "dataset":
            self.dataset = text.strip()
        elif name == "dictionary":
            title = Path(file_name).stem or "the dictionary"
            self.dictionary = dictionary_of_text(text, title) if text.strip() else None
        elif name == "dt":
            self.dt = _interval(text) if text.strip() else None
        else:
            self.name = text.strip()[:LONGEST_NAME]

    def read(self, most_bytes: int) -> RolloutFile:
        """Read the flights, in a separate process. TelemetryError; NoSpace."""
        source, name = self.folder / FILES, "the files"
        if len(self.files) == 1:
            source, name = source / self.files[0], self.files[0]
        with reporting_full_disk():
            return read_rollouts(
                source,
                self.dictionary,
                dt=self.dt,
                name=name,
                most_bytes=most_bytes,
                place=self.folder,
            )

    def check(self) -> None:
        """TelemetryError if parts cannot be used together."""
        if not (self.files or self.recordings):
            raise TelemetryError(
                "there is no file: send one or several files of rollouts, or name recordings"
            )
        if self.dataset:
            given = {"file": self.files, "dictionary": self.dictionary, "channel": self.channels}
            given |= {"limit": self.limits, "dt": self.dt}
            if wrong := [name for name, value in given.items() if value]:
                raise TelemetryError(
                    f"{wrong[0]} was given with a dataset, which has its own: leave it out"
                )

    def as_plain(self) -> dict[str, Any]:
        """Summary stored with a job."""
        most = 10
        more = [f"and {len(self.files) - most} more"] if len(self.files) > most else []
        return {
            "name": self.name,
            "files": [*self.files[:most], *more],
            "channels": self.channels,
            "limits": self.limits,
            "recordings": self.recordings[:most],
            "dataset": self.dataset,
            "dictionary": self.dictionary and self.dictionary.dictionary.name,
        }


def preview_of(read: RolloutFile) -> dict[str, Any]:
    """Channels of flights with their ranges, before limits are set."""
    ranges = {}
    y = complete(read.dictionary, read.y, read.dt)
    for c, channel in enumerate(read.dictionary.channels):
        values = y[..., c].ravel()
        ranges[channel.key] = {
            "low": float(np.fmin.reduce(values)),
            "high": float(np.fmax.reduce(values)),
            "rest": rest_of(y[:, 0, c], channel),
        }
    labels = read.fail_index
    if labels is not None and (labels == UNLABELLED).all():
        labels = None
    return {
        "dictionary": read.dictionary.to_plain(),
        "ranges": ranges,
        "n_flights": len(read.y),
        "n_samples": read.y.shape[1],
        "dt": read.dt,
        "n_failing": None if labels is None else int((labels >= 0).sum()),
        "n_flown": sum(each is not None for each in read.flown),
        "theta_names": read.theta_names,
    }


async def receive_rollouts(
    fields: AsyncIterator[SentField], sent: SentRollouts, require: Callable[[int], None]
) -> None:
    """Write the files among the fields, and take the others.

    TelemetryError for fields that cannot be used, and without a file; else as `upload.receive`.
    """
    (sent.folder / FILES).mkdir()
    async for each in fields:
        if each.name in TEXTS:
            sent.set_field(each.name, await _text(each), each.file_name)
            continue
        if each.name != "file":
            known = (
                "send files as file" if each.file_name else instead_of(each.name, ("file", *TEXTS))
            )
            raise TelemetryError(f"the form has the field {each.name}: {known}")
        name = plain_name(each.file_name)
        if name.startswith("."):
            continue  # of the sender's file manager
        name = name or plain_name(sent.name).lstrip(".") or "rollouts"
        if len(name.encode()) > MOST_NAME_BYTES:
            raise TelemetryError(
                f"the file name {name[:40]} ... has more than {MOST_NAME_BYTES} bytes: shorten it"
            )
        if name in sent.files:
            raise TelemetryError(f"two files have the name {name}: give each its own")
        if len(sent.files) == MOST_FILES:
            raise TelemetryError(
                f"there are more than {MOST_FILES} files: give one table with the column flight"
            )
        sent.files.append(name)
        received = await receive(each.content, sent.folder / FILES / name, require)
        sent.n_bytes += received.size
        if received.size == 0:
            raise TelemetryError(f"{name} is empty: choose files of rollouts")
    sent.check()
    sent.name = sent.name or (Path(sent.files[0]).stem if sent.files else "flown flights")


def failures_of(labels: Iterable[str], known: Mapping[str, str]) -> dict[str, tuple[float, ...]]:
    """Times of failure [s] by flight, none for a safe one, of `FLIGHT=safe`, `FLIGHT=12.3,40.1`.

    known: names of the flights.   TelemetryError.
    """
    failures = dict[str, tuple[float, ...]]()
    for text in labels:
        flight, equals, label = text.rpartition("=")
        flight = flight.strip()
        if not equals or flight not in known:
            raise TelemetryError(
                f"the label {text!r} is of no flight that was given: write it as FLIGHT={SAFE}, or "
                f"FLIGHT=TIME with the time of failure in seconds, for {', '.join(known) or 'one'}"
            )
        try:
            times = () if label.strip() == SAFE else tuple(map(float, label.split(",")))
        except ValueError:
            times = (nan,)
        if not all(map(isfinite, times)):
            raise TelemetryError(
                f"the label {label.strip()!r} of {known[flight]} gives no time: write {SAFE}, or "
                "times of failure in seconds, such as 12.3, 40.1"
            )
        failures[flight] = times
    return failures


async def _text(sent: SentField) -> str:
    content = bytearray()
    async for chunk in sent.content:
        content += chunk
        if len(content) > MOST_TEXT:
            raise TelemetryError(f"{sent.name} has more than {MOST_TEXT} bytes: send less")
    return content.decode("utf-8-sig", "replace")


def _interval(text: str) -> float:
    try:
        dt = float(text)
    except ValueError:
        dt = -1.0
    if not 0 < dt < inf:
        raise TelemetryError(f"dt is {text.strip()!r}: give the sample interval in seconds")
    return dt
