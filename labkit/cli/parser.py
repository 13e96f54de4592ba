"""The command-line parser and the layout of its help."""

from __future__ import annotations

import argparse
import inspect
import itertools
import re
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

from labkit.errors import InputError, nearest, option_name
from labkit.units import UNITS, plain_unit

UNIT_NAMES = {name.lower(): name for units in UNITS.values() for name in units}
POSITIONAL = ("path", "specimen", "figure", "file", "test")
HELP = {"-h", "--help"}


class Parser(argparse.ArgumentParser):
    """A parser that raises InputError with a one-line message and accepts no abbreviated options.

    `words` are the words to be parsed, because the help may depend on them; `arguments` are the arguments added so far.
    """

    def __init__(self, prog: str, words: Sequence[str] = (), description: str = "", usage: str | None = None) -> None:
        """Start without options."""
        self.words = words
        self.arguments: list[argparse.Action] = []
        self._groups: dict[str, Callable[..., argparse.Action]] = {}  # title in the help -> function to add options
        kind = argparse.RawDescriptionHelpFormatter
        super().__init__(prog, usage, wrap(description), formatter_class=kind, allow_abbrev=False)
        self.exit_on_error = False  # errors then contain the name of the option

    def add_argument(
        self, *names: str, group: str | None = None, note: str | None = None, **settings: Any
    ) -> argparse.Action:
        """Add an argument or option; `group` is the title of its group in the help, `note` the line below the title."""
        add = super().add_argument
        if group is not None:
            if group not in self._groups:
                self._groups[group] = self.add_argument_group(group, note and wrap(note, 4)).add_argument
            add = self._groups[group]
        self.arguments.append(add(*names, **settings))
        return self.arguments[-1]

    def error(self, message: str) -> NoReturn:
        """Raise InputError with the message and with the command that prints the help."""
        raise InputError(f"{message} (see {self.prog} --help)")

    def read(self, words: Sequence[str]) -> argparse.Namespace:
        """Parse the words of a command line. Raises InputError for an invalid word."""
        for before, word in itertools.pairwise(("the first word", *words)):
            if not word or re.fullmatch(r"--[a-z][a-z0-9-]*=(--)?", word):  # argparse reads -- as no value at all
                self.error(f"{word.partition('=')[0] or before} is empty: give a value")
            number, unit = before.rpartition("=")[2], UNIT_NAMES.get(plain_unit(word).lower())
            if re.fullmatch(r"[-+.\d][-+.\de]*", number) and unit:
                advice = f"write the value and its unit without a space, as in {number}{unit}, or in quotes"
                self.error(f"{word} stands alone: {advice}")
        try:
            options, unknown = self.parse_known_args(self._join_values(words))
        except argparse.ArgumentError as error:
            self.error(f"{error.argument_name}: {error.message}" if error.argument_name else error.message)
        if unknown:
            names = [name for argument in self.arguments for name in argument.option_strings]
            close = nearest(unknown[0].partition("=")[0], names)
            hint = "" if close is None else f": did you mean {close}?"
            self.error(f"{unknown[0]} is not an option of {self.prog}{hint}")
        return options

    def _join_values(self, words: Sequence[str]) -> list[str]:
        """Join values that begin with a hyphen, such as -300kPa, to their options: argparse would read an option -3."""
        options = {name for argument in self.arguments if argument.nargs is None for name in argument.option_strings}
        joined: list[str] = []
        for word in words:
            if joined and joined[-1] in options and re.match(r"-(\.?\d|,|inf|nan)", word, re.IGNORECASE):
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        return joined

    def shorten_usage(self) -> None:
        """Replace the list of all options in the usage line with `[options]`."""
        positional = [action for action in self.arguments if not action.option_strings]
        forms = {"+": "{0} [{0} ...]", "*": "[{0} ...]", "?": "[{0}]"}
        names = [forms.get(str(action.nargs), "{0}").format(action.metavar or action.dest) for action in positional]
        self.usage = " ".join([self.prog, *names, "[options]"]).replace("%", "%%")


def wrap(text: str, margins: int = 0) -> str:
    """Wrap each line of a help text separately, so that lists and examples keep their layout.

    Args:
        text: The text.
        margins: Columns of the terminal to leave empty, in addition to the two that argparse leaves empty.
    """
    width, lines = max(shutil.get_terminal_size().columns - 2 - margins, 11), []
    for line in text.splitlines():
        hanging = re.match(r"\s+\S+\s{2,}|\s*", line)
        gap = " " * len(hanging[0] if hanging else "")
        wrapper = textwrap.TextWrapper(width, "", gap, break_on_hyphens=False, break_long_words=False)
        lines += wrapper.wrap(line) or [""]
    return "\n".join(lines)


def on_command_line(field: str) -> str:
    """Return the command-line option of a parameter, or the name of a positional argument."""
    return field if field in POSITIONAL else option_name(field)


def name_list(title: str, texts: Mapping[str, str]) -> str:
    """Format a list for the end of a help text: names, each with its explanation."""
    width = max(map(len, texts), default=0)
    lines = [f"  {name:<{width}}  {text}".rstrip() for name, text in texts.items()]
    return "\n".join([f"{title}{'s' * (len(texts) > 1)}:", *lines])


def summary_of(entry: object) -> str:
    """Return the first sentence of the docstring of a registered entry, such as a path or figure; empty without one."""
    text = " ".join((inspect.getdoc(entry) or "").partition("\n\n")[0].split())
    if text.startswith(f"{getattr(entry, '__name__', '')}("):  # generated by dataclass
        return ""
    return re.split(r"\.(?= [A-Z]|$)", text)[0]
