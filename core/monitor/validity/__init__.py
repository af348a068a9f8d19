"""Validity: whether a flight is within a monitor's training."""
