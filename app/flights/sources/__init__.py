"""The sources of flights, and how each kind is flown."""
