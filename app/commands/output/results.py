"""What a command prints when its work is done: for a person, or as JSON."""

import argparse
from typing import Any


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option that prints results as JSON."""
    parser.add_argument("--json", action="store_true", help="print the results as JSON")


def print_result(options: argparse.Namespace, text: str, plain: Any) -> None:
    """Print one of both. plain: JSON's types and arrays; what is not finite becomes null."""
    if options.json:
        from app import json_codec  # slow to import, and only needed here

        text = json_codec.encode(plain).decode()
    print(text)
