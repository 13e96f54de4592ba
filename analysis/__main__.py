"""`python -m analysis COMMAND`: the studies, each of which says its own options."""

from __future__ import annotations

import importlib
import os
import shlex
import sys
from collections.abc import Sequence

from labkit.cli import run_command
from labkit.cli.arguments import Parser

COMMANDS = {  # name -> (module with add_options(parser) and main(options, command), help)
    "paper": ("analysis.paper.command", "the paper's tests: runs the campaign, makes tables, figures, a report"),
    "notebooks": ("analysis.paper.notebooks", "redraw the paper's figures with the notebooks of analysis/"),
    "report": ("analysis.paper.report", "one page of the paper's tests: figures, tables, provenance"),
    "model-figures": ("analysis.paper.model_figures", "Figs. 4 to 10 of the model alone, from Table 2"),
    "speed-error": ("analysis.speed_error.command", "speed against error of all settings: data, figures and a page"),
    "hard-cases": ("analysis.hard_cases.command", "scenes at which a simulation may go wrong: run, judged, a page"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a study; returns 0 done, 1 the physics or a check failed, 2 bad input."""
    argv = sys.argv[1:] if argv is None else list(argv)
    os.environ.setdefault("MPLBACKEND", "Agg")  # studies draw into files
    return run_command(build_parser(argv), argv)


def build_parser(argv: Sequence[str]) -> Parser:
    """The parser of a command line; it knows the options of that one study, as importing all of them takes long."""
    parser = Parser(prog="./lab", description="Studies made with labkit.")
    studies = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, (module, words) in COMMANDS.items():
        one = studies.add_parser(name, help=words)
        if name in argv[:1]:
            study = importlib.import_module(module)
            study.add_options(one)
            one.set_defaults(command=lambda options, argv: study.main(options, shlex.join(["./lab", *argv])))  # noqa: B023
    return parser


if __name__ == "__main__":
    sys.exit(main())
