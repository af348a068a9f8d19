"""Limits of a test, and the first exceedance."""
