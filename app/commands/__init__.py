"""The commands of `forewarn`, one file a command."""
