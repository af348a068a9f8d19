"""Flights under way: their sources, how they are played, who watches, what is recorded."""
