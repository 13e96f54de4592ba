"""`python -m analysis COMMAND`: the studies, registered next to labkit's own commands."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Annotated, Any

from labkit.cli.arguments import History
from labkit.cli.dispatch import main as run_command
from labkit.cli.registry import command

STUDIES = {  # name -> (module with STUDY, or with its add_options(parser) and main(options, command); help)
    "paper": ("analysis.paper.study", "run the paper's tests; write their tables, figures and report"),
    "notebooks": ("analysis.paper.notebooks", "execute the notebooks of analysis/, which plot stored results"),
    "report": ("analysis.paper.report", "write the HTML report of the paper's tests: figures, tables, provenance"),
    "model-figures": ("analysis.paper.model_figures", "draw Figs. 4 to 10 from the model only, with Table 2"),
    "other-paths": ("analysis.other_paths.study", "run paths beyond the paper's: errors of C0, strength"),
    "model-evidence": ("analysis.model_evidence.study", "judge the constitutive model on paths it was not fitted to"),
    "model-benchmark": ("analysis.model_benchmark.study", "score constitutive models on all stored tests"),
    "constants": ("analysis.constants.study", "do the constants of Table 2 hold for other grains? a sweep"),
    "critical-state": (
        "analysis.critical_state.study",
        "shear specimens to 100 % strain on many paths; is there one critical state?",
    ),
    "contact-limits": (
        "analysis.contact_limits.study",
        "what the limits of Eqs. 2 and 3 apply to, in pairs of specimens",
    ),
    "rotation": ("analysis.rotation.study", "rotate the principal stresses at the critical state: does e change?"),
    "initial-fabric": ("analysis.initial_fabric.study", "test initial fabric, and Z at equal e and p (Figs. 9, 10)"),
    "size-scatter": ("analysis.size_scatter.study", "scatter and bias of the critical state against the grains"),
    "three-engines": ("analysis.three_engines.command", "compare LAMMPS, YADE and fused on the same specimens"),
    "speed-error": ("analysis.speed_error.study", "measure speed against error of all settings; data, figures, page"),
    "boundary-value": (
        "analysis.boundary_value.command",
        "solve a biaxial test with finite elements; mesh convergence, iterations, fields",
    ),
    "fuzz": ("analysis.fuzz.command", "read damaged files, hostile options and campaign files; counts per class"),
    "results": ("analysis.freshness", "say which commit wrote each file of results/, and whether its code has changed"),
    "hard-cases": ("analysis.hard_cases.study", "run and judge scenes in which a simulation may go wrong; a page"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a study, with the error messages and exit codes of labkit's commands."""
    for name, (module, summary) in STUDIES.items():
        register(name, module, summary)
    return run_command(list(sys.argv[1:] if argv is None else argv))


def study(module: str) -> Any:
    """The study in a module, which is imported when it is needed."""
    found = importlib.import_module(module)
    return getattr(found, "STUDY", found)


class StudyOptions:
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
    sys.exit(main())
