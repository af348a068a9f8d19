"""A mapping for a person to complete when some channels have no source."""

from collections.abc import Collection
from dataclasses import asdict
from typing import Any

from app.telemetry.contents import Contents
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.targets import TARGETS
from core.channels import KEYS


def mapping_template(
    mapping: Mapping, contents: Contents, missing: Collection[str] = KEYS
) -> dict[str, Any]:
    """The mapping as plain data, with an empty entry for each missing channel; if no group has a
    time, also one for each group.
    """
    empty = {key: ChannelSource(unit=TARGETS[key].unit) for key in missing}
    groups = [group.name for group in contents.groups if group.n_rows > 1]
    times = mapping.times or {name: TimeSource() for name in groups}
    return {
        "channels": {
            key: asdict(mapping.channels.get(key) or empty[key])
            for key in TARGETS
            if key in mapping.channels or key in empty
        },
        "times": {name: asdict(source) for name, source in times.items()},
    }
