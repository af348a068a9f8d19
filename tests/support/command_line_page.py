"""Writes the guide's page on the command line from the parser: `make command-line`."""

import argparse
from collections.abc import Iterator

from app.cli import COMMANDS, _parser
from tests.support.places import ROOT

PAGE = ROOT / "static" / "guide" / "command-line.md"
HEAD = """# Command line

Every command of `forewarn`, with its arguments and options. `make command-line` writes this page
from the program.

Every command that prints results prints JSON with `--json`. A command exits with 0 only if it did
its work. An error is one line: what was given, what is needed, and what to do. A limit or a noise
is in SI and g, or in a unit that you write: `--limit beta=7deg`.
"""


def page() -> str:
    """The page as the parser has it now."""
    return "\n".join([HEAD, *_commands()])


def _commands() -> Iterator[str]:
    for name, text in COMMANDS.items():
        (subparsers,) = _actions(_parser(name), argparse._SubParsersAction)
        yield f"## forewarn {name}\n\n{_sentence(text)}\n"
        yield from _command(subparsers.choices[name])


def _command(parser: argparse.ArgumentParser) -> Iterator[str]:
    nested = _actions(parser, argparse._SubParsersAction)
    rows = [
        f"| {_name(action)} | {_cell(_meaning(parser, action))} |"
        for action in parser._actions
        if action not in nested
        and "--help" not in action.option_strings
        and action.help != argparse.SUPPRESS
    ]
    if rows:
        yield "\n".join(["| argument or option | meaning |", "|---|---|", *rows]) + "\n"
    for action in nested:
        words = {choice.dest: choice.help for choice in action._choices_actions}
        for name, child in action.choices.items():
            yield f"### {child.prog}\n\n{_sentence(words[name] or '')}\n"
            yield from _command(child)


def _actions(parser: argparse.ArgumentParser, kind: type) -> list:
    return [action for action in parser._actions if isinstance(action, kind)]


def _name(action: argparse.Action) -> str:
    value = "" if action.nargs == 0 else _value(action)
    if not action.option_strings:
        return f"`{_value(action)}`"
    return ", ".join(f"`{option}`" for option in action.option_strings) + (
        f" `{_cell(value)}`" if value else ""
    )


def _value(action: argparse.Action) -> str:
    if isinstance(action.metavar, str):
        return action.metavar
    if action.choices is not None:
        return "{" + ",".join(map(str, action.choices)) + "}"
    return (action.dest or "").upper()


def _meaning(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    if not action.help:
        return ""
    return parser._get_formatter()._expand_help(action)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
