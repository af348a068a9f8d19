"""Channels on one time grid, each from its own times, without inventing what was not measured."""
