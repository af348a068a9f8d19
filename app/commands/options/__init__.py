"""Options that commands share, and what is checked of them before any work."""
