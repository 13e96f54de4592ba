"""`labkit figure` and `grading`: draw runs and specimens."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated

from labkit.cli.arguments import Csv, Option, one_of
from labkit.cli.outputs import figure_name, require_outputs, write_outputs
from labkit.cli.parser import name_list, summary_of
from labkit.cli.registry import command
from labkit.cli.verify import runs_by_name
from labkit.errors import InputError
from labkit.runs.read.figures import FIGURES

STANDARD = {"groups": 5, "snapshot": -1, "without_equation": False}  # defaults of options that several figures share


def list_of_figures(words: Collection[str]) -> str:
    """List the figures for the end of the help; this imports matplotlib."""
    return name_list("figure", {name: summary_of(FIGURES[name]) for name in FIGURES})


@command("figure", epilog=list_of_figures)
def figure_command(
    figure: Annotated[str, Option(f"one of {', '.join(FIGURES)}", type=one_of(FIGURES))],
    run: Annotated[
        list[str],
        Option("run file; several for stress_path, pi_plane, shear, cycles and test; a probes file for envelope"),
    ],
    *,
    variable: Annotated[str | None, Option("recorded variable to draw (figure `records` only)")] = None,
    strength: Annotated[
        float | None,
        Option(
            "q/p in triaxial compression (figures `stress_path` and `pi_plane` only; default: that of the compression "
            "tests drawn, else that of Table 2 for the paper's soil, else no strength is drawn)",
            "M",
        ),
    ] = None,
    without_equation: Annotated[bool, Option("draw only the stress from contacts, not the equation")] = False,
    groups: Annotated[int, Option("number of grain-size groups")] = STANDARD["groups"],
    snapshot: Annotated[
        int, Option("number of the snapshot; a negative number counts from the end", type=int)
    ] = STANDARD["snapshot"],
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
    from labkit.runs.read.dataset import open_whole

    draw = FIGURES.require(figure, "figure")
    if len(run) > 1 and not draw.several:
        raise InputError("draws one run", field="figure", value=figure, allowed="one file")
    runs = {} if draw.needs == "probes" else runs_by_name(run)
    first = open_whole(run[0], "probes") if draw.needs == "probes" else next(iter(runs.values()))
    output = output or figure_name(run[0], variable or figure)
    require_outputs(output, csv)
    options: dict[str, object] = {"variable": variable, "strength": strength, "groups": groups, "snapshot": snapshot}
    options["without_equation"] = without_equation
    given = {name: value for name, value in options.items() if value != STANDARD.get(name)}
    drawn, table = draw(runs if len(runs) > 1 else first, **given)
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
    output = output or figure_name(file, "grading")
    require_outputs(output, csv)
    table = grading_figure.grading_table(state)
    print(table.to_string(index=False, float_format="%.4g"))
    write_outputs(grading_figure.grading(state), output, table, csv, [file])
