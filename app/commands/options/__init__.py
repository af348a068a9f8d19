"""Options that commands share, and their checks before any work."""
