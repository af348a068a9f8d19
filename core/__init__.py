"""Numerics of the safety monitor: arrays in, arrays out; no clock, web or database,
and no file but the portable monitor."""

__version__ = "0.2.0"
