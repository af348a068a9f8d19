"""Upkeep of stored data: backup, restore, retention and disk usage."""
