"""Flights in progress: sources, transport, watchers, alarms, records."""
