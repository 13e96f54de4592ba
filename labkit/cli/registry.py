"""Commands register themselves: a name, a sentence, options, and the function that does the work."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class Command:
    """options(parser) adds its options; execute(options, argv) returns an exit code, None for 0."""

    name: str
    help: str
    options: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace, list[str]], int | None]


COMMANDS: dict[str, Command] = {}

Execute = Callable[[argparse.Namespace, list[str]], "int | None"]


def command(name: str, help: str, options: Callable[[argparse.ArgumentParser], None]) -> Callable[[Execute], Execute]:
    """A decorator that registers a function as a command."""

    def register(execute: Execute) -> Execute:
        COMMANDS[name] = Command(name, help, options, execute)
        return execute

    return register
