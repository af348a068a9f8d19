"""The result of a command, printed as text or as JSON."""

import argparse
from typing import Any


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the results as JSON")


def print_result(options: argparse.Namespace, text: str, plain: Any) -> None:
    """plain: JSON types and arrays; numbers that are not finite become null."""
    if options.json:
        from app import json_codec  # slow to import, only needed here

        text = json_codec.encode(plain).decode()
    print(text)
