"""Where a flight's samples come from, and how each kind of source is flown."""
