"""The report of a scored flight: one HTML file that stands alone and prints to a clean PDF."""
