"""The portable file of a monitor: sections, checks and loading."""
