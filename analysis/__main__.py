"""`python -m analysis COMMAND`: the studies, registered next to labkit's own commands."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Annotated, Any

from analysis.places import ROOT, read_yaml
from labkit.cli import program
from labkit.cli.arguments import History, Section
from labkit.cli.dispatch import main as run_command
from labkit.cli.registry import command

STUDIES: dict[str, list[str]] = read_yaml(ROOT / "analysis" / "studies.yaml")  # name -> [module, help, options]


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a study, with the error messages and exit codes of labkit's commands."""
    for name, (module, summary, *_) in STUDIES.items():
        register(name, module, summary)
    return run_command(list(sys.argv[1:] if argv is None else argv))


def study(module: str) -> Any:
    """The study in a module, which is imported when it is needed."""
    found = importlib.import_module(module)
    return getattr(found, "STUDY", found)


class StudyOptions(Section):
    """The options of a study, which its module defines."""

    def __init__(self, module: str) -> None:
        """module: imported when its options are needed."""
        self.module = module

    def add(self, parser: argparse.ArgumentParser) -> None:
        """Adds the options."""
        study(self.module).add_options(parser)

    def read(self, options: argparse.Namespace) -> argparse.Namespace:
        """All options."""
        return options


def register(name: str, module: str, help: str) -> None:
    """Registers a study as a command."""

    def execute(options: argparse.Namespace, history: History) -> int | None:
        code: int | None = study(module).main(options, history.replace("labkit", "./lab", 1))
        return code

    execute.__annotations__["options"] = Annotated[argparse.Namespace, StudyOptions(module)]
    command(name, help)(execute)


if __name__ == "__main__":
    sys.exit(program(main))
