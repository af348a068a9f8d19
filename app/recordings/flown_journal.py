"""The journal of a live flight on its way to be a recording, with the mapping it was flown by."""

import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from app.recordings.files import spacious
from app.store.markers import Marker
from app.telemetry.contents import Columns
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import ATTITUDE
from app.telemetry.targets import TARGETS
from core.channels import KEYS


@dataclass(frozen=True)
class FlownJournal:
    """What a flight that is over leaves.

    mapping: None for our own names in SI units.   markers: that were set in it.
    """

    flight_id: str
    path: Path
    name: str
    aircraft: str | None = None
    mapping: Mapping | None = None
    markers: Sequence[Marker] = ()

    def mapping_for(self, columns: Columns) -> Mapping:
        """The mapping that the flight was read by, of what was sent."""
        names = {signal.name for signal in columns.contents.signals}
        (group,) = columns.contents.groups
        if self.mapping is None:
            own = [key for key in (*KEYS, *ATTITUDE) if key in names]
            channels = {key: ChannelSource(key, TARGETS[key].unit) for key in own}
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


def share(path: Path, target: Path) -> None:
    """Have a file under another name too, on the disk once where that can be. NoSpace."""
    with suppress(OSError):
        os.link(path, target)
        return
    with spacious():
        shutil.copyfile(path, target)
        target.chmod(0o600)


def _lacks(source: ChannelSource, channels: dict[str, ChannelSource]) -> bool:
    if not source.derivation:
        return False
    return any(need not in channels for need in DERIVATIONS[source.derivation].needs)
