"""The journal of an ended live flight, which becomes a recording with the mapping of the flight."""

import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from app.recordings.files import reporting_full_disk
from app.store.flights import FlightInfo
from app.store.recordings import Marker
from app.telemetry.contents import Columns
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import ATTITUDE
from app.telemetry.targets import TARGETS
from core.channels import LATERAL, Dictionary


@dataclass(frozen=True)
class FlownJournal:
    """Data of an ended flight.

    mapping: None for the keys of our channels, in their units.   markers: set during the flight.
    dictionary: of the monitor.
    """

    flight_id: str
    path: Path
    name: str
    aircraft: str | None = None
    mapping: Mapping | None = None
    markers: Sequence[Marker] = ()
    dictionary: Dictionary = LATERAL

    def mapping_for(self, columns: Columns) -> Mapping:
        """The mapping of the flight, reduced to the signals that were sent."""
        names = {signal.name for signal in columns.contents.signals}
        (group,) = columns.contents.groups
        if self.mapping is None:
            units = {known.key: known.unit for known in self.dictionary.channels}
            units |= {key: TARGETS[key].unit for key in ATTITUDE if key not in units}
            sent = [key for key in (*self.dictionary.measured, *ATTITUDE) if key in names]
            channels = {key: ChannelSource(key, units[key]) for key in sent}
            return Mapping(channels, {group.name: TimeSource(group.time)})
        times = [time for time in self.mapping.times.values() if time.signal]
        channels = {
            key: source
            for key, source in self.mapping.channels.items()
            if source.derivation or source.signal in names
        }
        while lacking := [key for key, source in channels.items() if _lacks(source, channels)]:
            channels = {key: channels[key] for key in channels if key not in lacking}
        return replace(self.mapping, channels=channels, times={group.name: times[0]})


def journal_damage(info: FlightInfo, digest: str | None) -> str:
    """Damage to the journal of a live flight; empty if none is known.

    digest: SHA-256 of its journal; None if there is none.
    """
    if digest is None:
        has_failed_at_its_start = info.status == "failed" and info.head is None
        return "" if has_failed_at_its_start else "its journal is missing"
    is_altered = info.journal_digest not in (None, digest)
    return "its journal was altered (its digest does not match)" if is_altered else ""


def link_or_copy(path: Path, target: Path) -> None:
    """Hard-link a file under another name, or copy it if that fails. NoSpace."""
    with suppress(OSError):
        os.link(path, target)
        return
    with reporting_full_disk():
        shutil.copyfile(path, target)
        target.chmod(0o600)


def _lacks(source: ChannelSource, channels: dict[str, ChannelSource]) -> bool:
    if not source.derivation:
        return False
    return any(need not in channels for need in DERIVATIONS[source.derivation].needs)
