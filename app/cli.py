"""The command `forewarn`: what it can be told to do, and how it ends."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib import import_module

from core import __version__

INTERRUPTED, MISTYPED = 130, 2

COMMANDS = {
    "study": "repeat the paper's experiment: five methods",
    "train": "simulate, train and test a monitor; write its file",
    "score": "score recorded telemetry with monitors",
    "report": "score recorded telemetry and report it in one HTML file that prints to a clean PDF",
    "sample-flight": "write a simulated flight as CSV, to score",
    "validity-matrix": "fly every published aircraft through the monitor of every other",
    "serve": "serve the page and the API",
    "demo": "train a small monitor, serve, and fly it",
    "doctor": "check this installation",
}
"""Name and help of each module in app/commands; it has `add` and `run`, and is loaded if named."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns 0 only where the work was done."""
    try:
        arguments = sys.argv[1:] if arguments is None else arguments
        named = next((word for word in arguments if not word.startswith("-")), None)
        if named is not None and named not in COMMANDS:
            return _refused(f"there is no command {named!r}", named, COMMANDS)
        parser = _parser(named)
        options, unknown = parser.parse_known_args(arguments)
        if unknown:
            words = f"{named} takes no {unknown[0]!r}"
            return _refused(words, unknown[0].partition("=")[0], options.known_options)
        from core.kernels.compiled import announce_compilation

        with announce_compilation(lambda text: print(f"forewarn: {text}", file=sys.stderr)):
            return options.run(options)
    except KeyboardInterrupt:
        print("forewarn: interrupted, nothing was written", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError) as error:
        print(f"forewarn: {error}", file=sys.stderr)
        return 1
    except MemoryError as error:
        print(f"forewarn: memory does not suffice ({error}): ask for less", file=sys.stderr)
        return 1


def _refused(what: str, word: str, known: Iterable[str]) -> int:
    """Say what was mistyped and what is closest to it."""
    close = get_close_matches(word, known, n=1, cutoff=0.5)
    instead = f"did you mean {close[0]}?" if close else f"choose {', '.join(known)}"
    print(f"forewarn: {what}: {instead}", file=sys.stderr)
    return MISTYPED


def _parser(named: str | None) -> argparse.ArgumentParser:
    """A parser that knows every command by name, and the one that is named in full."""
    parser = argparse.ArgumentParser(
        prog="forewarn",
        description="Warns a stated time before a flight-test manoeuvre exceeds a limit.",
    )
    parser.add_argument("--version", action="version", version=f"forewarn {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        command = commands.add_parser(name, help=text, allow_abbrev=False)
        if name == named:
            module = import_module(f"app.commands.{name.replace('-', '_')}")
            module.add(command)
            options = [option for action in command._actions for option in action.option_strings]
            command.set_defaults(run=module.run, known_options=options)
    return parser
