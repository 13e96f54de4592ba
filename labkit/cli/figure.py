"""`labkit figure` and `grading`: draw runs and specimens."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Annotated

from labkit.cli.arguments import Csv, Instance, Option, one_of
from labkit.cli.outputs import name_beside, require_outputs, write_outputs
from labkit.cli.parser import name_list, summary_of
from labkit.cli.registry import command
from labkit.cli.verify import runs_by_name
from labkit.errors import InputError
from labkit.parameters import Number, check_parameters, parameter
from labkit.results.figures import FIGURES


@dataclasses.dataclass(frozen=True)
class FigureOptions:
    """Options that figures share."""

    variable: str | None = parameter(None, kind=str, help="recorded variable to draw (figure `records` only)")
    strength: Number[float | None] = parameter(
        None,
        help="q/p in triaxial compression (figures `stress_path` and `pi_plane` only; default: that of the compression "
        "tests drawn, else that of Table 2 for the paper's soil, else no strength is drawn)",
    )
    equation: bool = parameter(True, help="draw the stress-force-fabric equation beside the stress from contacts")
    step: str | None = parameter(
        None, kind=str, help="step of a path file to draw, such as 2, or several, such as 4-18 (default: the whole run)"
    )
    groups: Number[int] = parameter(5, low=1, help="number of grain-size groups")
    snapshot: Number[int] = parameter(-1, help="number of the snapshot; a negative number counts from the end")

    def __post_init__(self) -> None:
        """Check every parameter, and convert the texts of a command line. Raises InputError."""
        check_parameters(self)


STANDARD = FigureOptions()


def list_of_figures(words: Collection[str]) -> str:
    """List the figures for the end of the help; this imports matplotlib."""
    return name_list("figure", {name: summary_of(FIGURES[name]) for name in FIGURES})


@command("figure", epilog=list_of_figures)
def figure_command(
    figure: Annotated[str, Option(f"one of {', '.join(FIGURES)}", type=one_of(FIGURES))],
    run: Annotated[
        list[str],
        Option(
            "run file; several for test, stress_path, pi_plane, shear, rotation, compression, cycles and "
            "liquefaction; a probes file for envelope"
        ),
    ],
    *,
    options: Annotated[FigureOptions, Instance(FigureOptions, "figure")],
    output: Annotated[str | None, Option("figure to write (default: next to the run file)", "FILE")] = None,
    csv: Csv = None,
) -> None:
    """Draws a figure of a run.

    Writes the figure, and prints the table behind it or writes it as CSV.

    Examples:
        labkit figure family r.run.nc
        labkit figure records r.run.nc --variable void_ratio
    """
    from labkit.figures import plots
    from labkit.results.dataset import open_whole

    draw = FIGURES.require(figure, "figure")
    if len(run) > 1 and not draw.several:
        raise InputError("draws one run", field="figure", value=figure, allowed="one file")
    runs = {} if draw.needs == "probes" else runs_by_name(run)
    first = open_whole(run[0], "probes") if draw.needs == "probes" else next(iter(runs.values()))
    output = output or name_beside(run[0], f".{options.variable or figure}.png")
    require_outputs(output, csv)
    changed = {name: value for name, value in vars(options).items() if value != getattr(STANDARD, name)}
    drawn, table = draw(runs if len(runs) > 1 else first, **changed)
    if len(runs) == 1:
        plots.name_run(drawn, first)  # a user's figure may not name its run
    write_outputs(drawn, output, table, csv, run)
    if not csv:
        print(table.to_string(index=False, float_format="%.4g", max_rows=30))


@command("grading")
def grading_command(
    file: Annotated[str, Option("state or run file")],
    *,
    output: Annotated[str | None, Option("figure to write (default: next to the file)", "FILE")] = None,
    csv: Csv = None,
) -> None:
    """Compares the requested grading with the sizes of the grains.

    Prints a table and writes a figure.

    Example:
        labkit grading s.state.nc
    """
    from labkit.figures import grading_figure
    from labkit.grains.state_file import read_state

    state = read_state(file)
    output = output or name_beside(file, ".grading.png")
    require_outputs(output, csv)
    table = grading_figure.grading_table(state)
    print(table.to_string(index=False, float_format="%.4g"))
    write_outputs(grading_figure.grading(state), output, table, csv, [file])
