"""What a signal is by its name: its words, its unit, and what flight test calls the channels."""
