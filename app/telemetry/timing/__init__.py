"""The times of a recording as a clock can have given them, and how good its channels are."""
