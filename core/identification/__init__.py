"""Identification: parameters of an uncertain aircraft from recorded flights."""
