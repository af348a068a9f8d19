"""Identification: what recorded flights say of an aircraft whose parameters are uncertain."""
