"""Commands, options, defaults and choices of labkit, and the names of its front door, before and after a change.

    python benchmarks/options.py write before.json            # of the labkit that Python imports
    python benchmarks/options.py compare before.json after.json

Reads the parsers behind `labkit COMMAND --help`. `compare` prints everything that is missing, different or new; the
exit code is 1 if anything is missing or different.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import sys
from pathlib import Path
from unittest import mock

import labkit
from labkit.cli import main as labkit_command

Listed = dict[str, dict[str, object]]  # option -> its properties


def list_names() -> dict[str, object]:
    """List the names of the front door and the options of all commands."""
    return {"front_door": sorted(labkit.__all__), "commands": command_options()}


def command_options() -> dict[str, Listed]:
    """Return all commands and their options; the command "" stands for labkit itself."""
    (general,) = parsers("--help")
    found = {"": options_of(general)}
    for name in re.findall(r"^ {2,4}([a-z][a-z-]+)(?: {2}|$)", general.format_help(), re.MULTILINE):
        (parser,) = parsers(name, "--help")
        found[name] = options_of(parser)
    return found


def parsers(*words: str) -> list[argparse.ArgumentParser]:
    """Return the parsers that print their help for a command line."""
    asked: list[argparse.ArgumentParser] = []
    with (
        mock.patch.object(argparse.ArgumentParser, "print_help", lambda self, file=None: asked.append(self)),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.suppress(SystemExit),
    ):
        labkit_command(list(words))
    return asked


def options_of(parser: argparse.ArgumentParser) -> Listed:
    """Return the options and positional arguments of a parser."""
    found: Listed = {}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            continue  # the commands
        properties: dict[str, object] = {
            "takes": action.nargs,
            "default": None if action.default is argparse.SUPPRESS else repr(action.default),
            "choices": None if action.choices is None else list(action.choices),
            "required": action.required and action.nargs != "*",
            "help": action.help,
        }
        found |= {name: properties for name in action.option_strings or [str(action.metavar or action.dest)]}
    return found


def compare(before: Path, after: Path) -> int:
    """Print the differences between two files of `write`; return 1 if anything is missing or different."""
    one, other = (json.loads(file.read_text()) for file in (before, after))
    gone = [f"labkit.{name}: gone" for name in one["front_door"] if name not in other["front_door"]]
    new = [f"labkit.{name}" for name in other["front_door"] if name not in one["front_door"]]
    for name, options in one["commands"].items():
        if name not in other["commands"]:
            gone.append(f"{name}: gone")
            continue
        again = other["commands"][name]
        gone += [f"{name} {option}: gone" for option in options if option not in again]
        new += [f"{name} {option}" for option in again if option not in options]
        for option, properties in options.items():
            gone += changes(f"{name} {option}", properties, again.get(option, properties))
    new += [f"the command {name}" for name in other["commands"] if name not in one["commands"]]
    print(*gone, *(f"new: {name}" for name in new), sep="\n")
    count = sum(len(options) for options in one["commands"].values())
    print(f"{len(one['commands']) - 1} commands with {count} options before: {len(gone)} gone or different")
    return 1 if gone else 0


def changes(option: str, before: dict[str, object], after: dict[str, object]) -> list[str]:
    """Describe the differences of an option; choices may be added, and the help may change."""
    old, new = before["choices"], after["choices"]
    less = isinstance(old, list) and not set(old) <= set(new if isinstance(new, list) else old)
    kept = ("takes", "default", "required")
    found = [f"{option}: {name} {before[name]} -> {after[name]}" for name in kept if before[name] != after[name]]
    return found + ([f"{option}: choices {old} -> {new}"] if less else [])


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("write").add_argument("file", type=Path)
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    options = parser.parse_args()
    if options.command == "compare":
        return compare(options.before, options.after)
    options.file.write_text(json.dumps(list_names(), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
