"""The command `forewarn`: its commands, and its exit codes."""

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Any, NoReturn

from core import __version__
from core.mistyped import instead_of

INTERRUPTED, MISTYPED = 130, 2

COMMANDS = {
    "study": "repeat the paper's experiment: five methods",
    "sweep": "find how early each method can warn of planned tests, and at what cost",
    "train": "simulate, train and test a monitor; write its file",
    "combine": "make one monitor of several of one planned test, calibrated as a whole",
    "choose-epsilon": "choose an epsilon by costs, or so that misses and false alarms keep targets",
    "certificate": "write a monitor's certificate as a page to print",
    "campaign": "plan a build-up; clear, fly and identify its points one by one",
    "score": "score recorded telemetry with monitors",
    "report": "score recorded telemetry and report it in one HTML file that prints to a clean PDF",
    "sample-flight": "write a simulated flight as CSV, to score",
    "serve": "serve the page and the API",
    "push": "push a recording into a live flight, as a source does",
    "backup": "write database and recordings into one file, also while the server runs",
    "restore": "restore a backup, whole or not at all",
    "token": "make, list and revoke the tokens of people",
    "audit": "print the log of changes of a server",
    "retain": "delete old flights and recordings by age and size, except those kept permanently",
    "demo": "train a small monitor, serve, and fly it",
    "doctor": "check this installation",
}
"""Name and help of each module in app/commands; it has `add` and `run`, and is loaded if named."""


OPTIONS = ("-h", "--help", "--version")
"""What can be asked without a command."""
OF_COMMANDS = ("--json",)
"""Options of commands that are tried alone."""
INVALID = re.compile(r"invalid (\w+) value: (.*)")
NUMBERS = {
    "int": "give a whole number",
    "float": "give a number",
    "number_or_auto": "give a number, or auto",
}
"""What is needed, by the function that could not read a value."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns 0 only where the work was done."""
    try:
        arguments = sys.argv[1:] if arguments is None else arguments
        named = next((word for word in arguments if not word.startswith("-")), None)
        if named is not None and named not in COMMANDS:
            return _refused(f"there is no command {named!r}", named, COMMANDS)
        alone = next((word for word in arguments if word not in OPTIONS), None)
        if named is None and alone is not None:
            return _refused(f"{alone!r} needs a command before it", alone, OF_COMMANDS)
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
    print(f"forewarn: {what}: {instead_of(word, known)}", file=sys.stderr)
    return MISTYPED


class _Parser(argparse.ArgumentParser):
    """Refuses in one line, with the value that was most likely meant."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and end."""
        words = INVALID.sub(lambda found: f"{found[2]} was given: {NUMBERS[found[1]]}", message)
        print(f"forewarn: {words.removeprefix('argument ')}", file=sys.stderr)
        raise SystemExit(MISTYPED)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            words = f"{value!r} is unknown: {instead_of(str(value), map(str, action.choices))}"
            raise argparse.ArgumentError(action, words)


def _parser(named: str | None) -> argparse.ArgumentParser:
    """A parser that knows every command by name, and the one that is named in full."""
    parser = _Parser(
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


if __name__ == "__main__":
    sys.exit(main())
