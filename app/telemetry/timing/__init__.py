"""Repair the times of a recording and report the quality of times and channels."""
