"""Validity: whether a flight is one that a monitor can speak of, and what that is judged by."""
