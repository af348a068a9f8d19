"""Upkeep of what is stored: backups, how long things are kept, and the disk that they take."""
