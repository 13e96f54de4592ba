"""`python -m analysis COMMAND`: the studies, which register themselves beside labkit's commands."""

from __future__ import annotations

import argparse
import importlib
import shlex
import sys
from collections.abc import Sequence

from labkit.cli.dispatch import main as run_command
from labkit.cli.registry import command

STUDIES = {  # name -> (module with add_options(parser) and main(options, command), help); imported when asked for
    "paper": ("analysis.paper.command", "the paper's tests: runs the campaign, makes tables, figures, a report"),
    "notebooks": ("analysis.paper.notebooks", "redraw the paper's figures with the notebooks of analysis/"),
    "report": ("analysis.paper.report", "one page of the paper's tests: figures, tables, provenance"),
    "model-figures": ("analysis.paper.model_figures", "Figs. 4 to 10 of the model alone, from Table 2"),
    "speed-error": ("analysis.speed_error.command", "speed against error of all settings: data, figures and a page"),
    "hard-cases": ("analysis.hard_cases.command", "scenes at which a simulation may go wrong: run, judged, a page"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a study, with the errors and exit codes of labkit's commands."""
    for name, (module, words) in STUDIES.items():
        register(name, module, words)
    return run_command(list(sys.argv[1:] if argv is None else argv))


def register(name: str, module: str, help: str) -> None:
    """Makes a study a command; its module says its options."""

    def options(parser: argparse.ArgumentParser) -> None:
        importlib.import_module(module).add_options(parser)

    @command(name, options, help)
    def execute(options: argparse.Namespace, argv: list[str]) -> int | None:
        return importlib.import_module(module).main(options, shlex.join(["./lab", *argv]))


if __name__ == "__main__":
    sys.exit(main())
