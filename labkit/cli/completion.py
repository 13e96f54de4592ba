"""The command `labkit completion`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Annotated

import shtab

from labkit.cli.arguments import Option, one_of
from labkit.cli.dispatch import parser_for
from labkit.cli.registry import command, find_command, summaries
from labkit.errors import InputError
from labkit.paths.registry import PATHS
from labkit.results.figures import FIGURES

CHOICES: dict[str, Iterable[str]] = {"path": PATHS, "figure": FIGURES}  # argument -> values that it accepts


@command("completion")
def completion(shell: Annotated[str, Option("name of the shell", type=one_of(shtab.SUPPORTED_SHELLS))]) -> None:
    """Print a script with which a shell completes commands, options, paths and figures.

    Examples:
        labkit completion bash  # save the output as ~/.local/share/bash-completion/completions/labkit
        labkit completion zsh   # into _labkit, in a folder of $fpath
    """
    whole = argparse.ArgumentParser("labkit")
    commands = whole.add_subparsers()
    for name, summary in summaries().items():
        try:
            found_command = find_command(name)
        except InputError:  # a benchmark, which the installed package lacks
            continue
        if found_command is not None:
            parser = parser_for(found_command, ())
            for argument in parser.arguments:
                argument.choices = CHOICES.get(argument.dest)
            commands.add_parser(name, parents=[parser], add_help=False, help=summary)
    print(shtab.complete(whole, shell))
