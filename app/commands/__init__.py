"""The commands of `forewarn`, one file a command: `add` its options to a parser, `run` it."""
