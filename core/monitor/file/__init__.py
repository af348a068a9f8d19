"""The portable file of a monitor: its sections, what they must hold, and how they are read."""
