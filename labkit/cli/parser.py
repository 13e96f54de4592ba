"""The parser of command lines, and how a command line calls a parameter."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from labkit.errors import InputError, option_name

POSITIONAL = ("path", "specimen", "figure")


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line: InputError instead of usage and exit. No abbreviations of options."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        """Arguments of argparse.ArgumentParser."""
        super().__init__(*arguments, allow_abbrev=False, **keywords)

    def error(self, message: str) -> NoReturn:
        """Raises InputError with the message and where to find help."""
        raise InputError(f"{message} (see {self.prog} --help)")


def named(field: str) -> str:
    """How the command line calls a parameter."""
    return field if field in POSITIONAL else option_name(field)
