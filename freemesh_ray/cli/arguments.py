"""The grammar that all commands share: types of arguments, groups of options, and how a mistake is told."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from envs.errors import BAD_INPUT
from envs.printable import printable
from freemesh_ray.formatting import terminal


class Parser(argparse.ArgumentParser):
    """A parser whose mistakes are one line."""

    def error(self, message: str) -> NoReturn:
        """End with the line and exit code 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        if message:
            terminal.write(file or sys.stderr, message)


def add_command(commands: Any, name: str, brief: str, description: str, epilog: str = "") -> argparse.ArgumentParser:
    """The parser of one more command.

    Args:
        commands: what ``add_subparsers`` gave.
        name: of the command.
        brief: what the list of all commands says of it.
        description: what its own help begins with.
        epilog: what its help ends with, examples most often.
    """
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=brief, description=description, epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    return parser


def add_settings(parser: argparse.ArgumentParser, of_what: str) -> None:
    """``--set``."""
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help=f"a setting {of_what}; comes last; repeatable"
    )


def add_policy(parser: Any, default: str = "the shipped one", more: str = "") -> None:
    """``--policy``."""
    parser.add_argument("--policy", metavar="FILE", help=f"policy.npz of a training (default: {default}){more}")


def add_fix_parity(parser: Any) -> None:
    """``--fix-parity``."""
    parser.add_argument("--fix-parity", action="store_true", help="split the longest segment where a ring is odd")


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number in [low, high]."""

    def number(text: str) -> int:
        try:
            if low <= (value := int(text)) <= high:
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"{text!r}: give a whole number in [{low}, {high}]")

    return number


def below(limit: float, meaning: str) -> Callable[[str], float]:
    """A number in (0, limit); ``meaning`` is what a mistake is told to give."""

    def number(text: str) -> float:
        try:
            if 0.0 < (value := float(text)) < limit:
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"{text!r}: give {meaning}")

    return number


positive = below(math.inf, "a number above 0")
seconds = below(86_400.0, "a number of seconds above 0, below a day")
