"""The commands: one decorated function each.

The signature defines the arguments and options (see `arguments`), the docstring the help. labkit's own commands are
listed here with their modules, which are imported when a command is used. Any other file registers its own commands:

    @command("porosity", "print the porosity of a specimen")
    def porosity(file: Annotated[str, Option("state file")], *, digits: Annotated[int, Option("of it")] = 3) -> None:
        ...
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from collections.abc import Callable

from labkit import extensions
from labkit.errors import InputError
from labkit.plugins import COMMANDS, load_plugins

Function = Callable[..., "int | None"]

# name -> (module, summary); plug-ins add their commands
BUILT_IN = {
    "specimen": ("labkit.cli.simulate", "make a specimen"),
    "consolidate": ("labkit.cli.simulate", "consolidate a specimen isotropically to a pressure"),
    "bond": ("labkit.cli.simulate", "bond the grains of a specimen"),
    "run": ("labkit.cli.simulate", "load a specimen along a path"),
    "verify": ("labkit.cli.verify", "compare C0 with Love's stress and check the held quantities"),
    "critical": ("labkit.cli.verify", "tabulate the critical states of shear tests"),
    "figure": ("labkit.cli.figure", "draw a figure of a run"),
    "grading": ("labkit.cli.figure", "compare the size distribution of the grains with the grading of the scene"),
    "info": ("labkit.cli.verify", "show the contents and the origin of a file"),
    "model": ("labkit.cli.model", "integrate the constitutive model along a loading path"),
    "completion": ("labkit.cli.completion", "print a script with which bash or zsh completes commands and options"),
    "demo": ("labkit.cli.demo", "make a specimen, test it and verify the test, in a few minutes"),
}


@dataclasses.dataclass(frozen=True)
class Command:
    """A command of the command line.

    Args:
        name: Name on the command line.
        summary: One line of text in `labkit --help`.
        function: Carries out the command; returns an exit code, or None for 0.
        epilog: Makes text for the end of the help, such as the list of loading paths, from the words typed.
    """

    name: str
    summary: str
    function: Function
    epilog: Callable[[list[str]], str] | None = None

    @property
    def description(self) -> str:
        """The docstring of the function in one paragraph, without the examples."""
        text = (inspect.getdoc(self.function) or "").partition("\n\nExample")[0]
        return " ".join(text.split()) or f"{self.summary[:1].upper()}{self.summary[1:]}."

    @property
    def examples(self) -> str:
        """The examples of the docstring, for the end of the help; empty if there are none."""
        _, heading, text = (inspect.getdoc(self.function) or "").partition("\n\nExample")
        text = re.sub(r"\n {5,}", " ", text)  # a deeper indentation continues a line
        lines = [f"  {line.strip()}" for line in text.splitlines()[1:]]
        return "\n".join([f"example{'s' * (len(lines) > 1)}:", *lines]) if heading else ""


REGISTERED: dict[str, Command] = {}


def command(
    name: str, summary: str = "", epilog: Callable[[list[str]], str] | None = None
) -> Callable[[Function], Command]:
    """Return a decorator that makes a function a command; only commands outside labkit need a `summary`."""

    def register(function: Function) -> Command:
        earlier = all_commands().get(name)
        if earlier is not None and earlier[0] != function.__module__:
            raise InputError("is the name of another command", field="name", value=name, allowed="another name")
        REGISTERED[name] = Command(name, summary or (earlier[1] if earlier else name), function, epilog)
        return REGISTERED[name]

    return register


def all_commands() -> dict[str, tuple[str, str]]:
    """Return the commands of labkit and of its plug-ins in the order of the help, name -> (module, summary)."""
    load_plugins()
    names = [*BUILT_IN]
    for name, offer in COMMANDS.items():
        names.insert(names.index(offer.after) + 1 if offer.after in names else len(names), name)
    return {name: (BUILT_IN | COMMANDS)[name][:2] for name in names}


def summaries() -> dict[str, str]:
    """Return the summary of every installed or loaded command, name -> text."""
    listed = {name: summary for name, (_, summary) in all_commands().items()}
    return listed | {name: registered.summary for name, registered in REGISTERED.items()}


def find_command(name: str) -> Command | None:
    """Return the command with this name, or None if it is unknown."""
    if name not in REGISTERED and name in all_commands():
        importlib.import_module(all_commands()[name][0])
    if name not in REGISTERED:
        extensions.load_extensions()
    return REGISTERED.get(name)
