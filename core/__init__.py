"""Numerics of the safety monitor: arrays in, arrays out; no files, clock, web or database."""

__version__ = "0.1.0"
