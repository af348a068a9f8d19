"""Uploaded files: received, read, mapped, scored and kept."""
