"""Uploaded files: receive, read, map, score and store them."""
