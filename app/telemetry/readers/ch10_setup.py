"""What a Chapter 10 recording says of itself: names of its channels, and the time of day.

Reference: IRIG 106-17, chapters 9 (TMATS, the R attributes) and 11.2.3 ("Time data packets").
"""

import re
from datetime import datetime

from app.telemetry.readers.ch10_packets import Packet

SOURCE = re.compile(rb"R-(\d+)\\(TK1|DSI)-(\d+):([^;]*);")
LONGEST = 40


def channel_names(packet: Packet) -> dict[int, str]:
    """The data sources by the number of their channel, as the set-up record lists them."""
    from chapter10.computer import ComputerF1

    entries: dict[tuple[bytes, bytes], dict[bytes, str]] = {}
    for recorder, key, number, value in SOURCE.findall(packet.opened(ComputerF1).data):
        text = value.decode("utf-8", "replace").strip()[:LONGEST]
        entries.setdefault((recorder, number), {})[key] = text
    return {
        int(entry[b"TK1"]): entry[b"DSI"]
        for entry in entries.values()
        if entry.get(b"TK1", "").isdecimal() and b"DSI" in entry
    }


def moment(packet: Packet) -> datetime | None:
    """The date and time of day of a time packet, None where it does not tell the year."""
    from chapter10.time import TimeF1

    opened = packet.opened(TimeF1)
    return opened.time if opened.date_format else None
