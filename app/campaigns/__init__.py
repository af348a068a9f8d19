"""Campaigns: build-ups that are planned, flown, identified and cleared point by point."""
