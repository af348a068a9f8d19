"""The command line `forewarn`: its commands, mistyped arguments and exit codes."""

import argparse
import gc
import re
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Any, NoReturn

from core import __version__
from core.recipe import instead_of

INTERRUPTED, MISTYPED = 130, 2

COMMANDS = {
    "study": "repeat the paper's experiment: five methods, beside the rules of others",
    "sweep": "compare how early each method can warn, and at what cost",
    "train": "simulate, train and test a monitor; write its file",
    "combine": "combine several monitors of one planned test, calibrated as a whole",
    "choose-epsilon": "choose epsilon from costs, or from limits on misses and false alarms",
    "certificate": "write a monitor's results on fresh flights as a printable page",
    "campaign": "plan a build-up; clear, fly and identify its points one by one",
    "score": "score recorded telemetry with monitors",
    "score-archive": "score a folder of recordings, and again what has changed",
    "report": "score recorded telemetry and write a printable HTML report",
    "sample-flight": "write a simulated flight as a CSV file to score",
    "serve": "serve the page and the API",
    "push": "send a recording to a live flight, as a telemetry source does",
    "mqtt": "connect a flight with an MQTT broker: samples in, assessments and alarms out",
    "backup": "write the database and the recordings to one file; the server may run",
    "restore": "restore a backup, completely or not at all",
    "copy-store": "copy a database to an empty one, SQLite or PostgreSQL",
    "token": "create, list and revoke access tokens",
    "audit": "print who changed what on a server, and when",
    "retain": "delete old flights and recordings by age and size, except those kept permanently",
    "demo": "train a small monitor, start a server, and fly a flight",
    "doctor": "check this installation",
}
"""Name and help of each module in app/commands. Each has `add` and `run`; only the named one is
imported."""


OPTIONS = ("-h", "--help", "--version")
"""Options that need no command."""
OF_COMMANDS = ("--json",)
"""Options of commands, often given without one."""
INVALID = re.compile(r"invalid (\w+) value: (.*)")
INTO = re.compile(r"one of the arguments (--flight .*) is required")
FIELD = re.compile(r"(?<![\w.'])[a-z]+(?:_[a-z]+)+(?!\w|\.\w|')")
"""Name of a field, not within a path or quotes."""
NUMBERS = {
    "int": "give a whole number",
    "float": "give a number",
    "numbers": "give numbers, separated by commas",
    "number_or_auto": "give a number, or auto",
    "miss_rates": "give miss rates between 0 and 1, separated by commas",
    "trim": "give a number of seconds, trim-segment or none",
    "manoeuvres": "give detected, entire, or START:END in seconds, separated by commas",
}
"""What to do, by the function that could not read a value."""
COLLECTED = 20_000, 50, 10
"""Thresholds of the garbage collector: rare collections, so that no sample waits, and a server
starts in five sixths of the time."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns 0 only where the work was done."""
    known: Sequence[str] = ()
    gc.set_threshold(*COLLECTED)
    try:
        arguments = sys.argv[1:] if arguments is None else arguments
        command = next((word for word in arguments if not word.startswith("-")), None)
        if command is not None and command not in COMMANDS:
            return _refused(f"unknown command {command!r}", command, COMMANDS)
        option = next((word for word in arguments if word not in OPTIONS), None)
        if command is None and option is not None:
            return _refused(f"{option!r} needs a command before it", option, OF_COMMANDS)
        options, unknown = _parser(command).parse_known_args(arguments)
        if unknown and not unknown[0].startswith("-"):
            takes = " ".join(options.arguments) or "options only"
            words = " ".join(map(repr, unknown))
            print(f"forewarn: {command} takes {takes}: leave out {words}", file=sys.stderr)
            return MISTYPED
        if unknown:
            message = f"{command} does not accept {unknown[0]!r}"
            return _refused(message, unknown[0].partition("=")[0], options.known_options)
        known = options.known_options
        from core.kernels.compiled import announce_compilation

        with announce_compilation(lambda text: print(f"forewarn: {text}", file=sys.stderr)):
            return options.run(options)
    except KeyboardInterrupt:
        print("forewarn: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError) as error:
        print(f"forewarn: {_as_options(f'{error}', known)}", file=sys.stderr)
        return 1
    except MemoryError as error:
        print(f"forewarn: out of memory ({error}): ask for less", file=sys.stderr)
        return 1


def _as_options(message: str, known: Iterable[str]) -> str:
    """A message that names the options of the command instead of the fields that they set."""
    fields = {option[2:].replace("-", "_"): option for option in known if option.count("-") > 2}
    return FIELD.sub(lambda match: fields.get(match[0], match[0]), message)


def _refused(message: str, word: str, known: Iterable[str]) -> int:
    """Print the message with the known word closest to the mistyped one."""
    print(f"forewarn: {message}: {instead_of(word, known)}", file=sys.stderr)
    return MISTYPED


class _Parser(argparse.ArgumentParser):
    """Prints errors in one line, with the value that was most likely meant."""

    def error(self, message: str) -> NoReturn:
        message = INVALID.sub(lambda match: f"{match[2]} was given: {NUMBERS[match[1]]}", message)
        message = INTO.sub(
            r"give one of \1 with an id: it ends the address of a page (Fly, "
            r"Monitors), and is in GET /flights and GET /monitors",
            message,
        )
        print(f"forewarn: {message.removeprefix('argument ')}", file=sys.stderr)
        raise SystemExit(MISTYPED)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            message = f"{value!r} is unknown: {instead_of(str(value), map(str, action.choices))}"
            raise argparse.ArgumentError(action, message)


def _parser(command: str | None) -> argparse.ArgumentParser:
    """A parser with the names of all commands, and the options of this one."""
    parser = _Parser(
        prog="forewarn",
        description="Warns a set time before a flight-test manoeuvre exceeds a limit.",
    )
    parser.add_argument("--version", action="version", version=f"forewarn {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        subparser = commands.add_parser(name, help=text, allow_abbrev=False)
        if name == command:
            module = import_module(f"app.commands.{name.replace('-', '_')}")
            module.add(subparser)
            options = [option for action in subparser._actions for option in action.option_strings]
            taken = [
                str(action.metavar) for action in subparser._actions if not action.option_strings
            ]
            subparser.set_defaults(run=module.run, known_options=options, arguments=taken)
    return parser


if __name__ == "__main__":
    sys.exit(main())
