"""`labkit figure`, `grading`, `picture` and `watch`: draw runs and specimens."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import Csv, Option, one_of
from labkit.cli.outputs import figure_name, require_outputs, write_outputs
from labkit.cli.parser import name_list, summary_of
from labkit.cli.registry import command
from labkit.cli.verify import runs_by_name
from labkit.errors import InputError
from labkit.io.netcdf import labkit_kind
from labkit.runs.read.figures import FIGURES

STANDARD = {"groups": 5, "snapshot": -1}  # defaults of options that several figures share


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
            "tests drawn, else that of Table 2, or the largest of the tests of another soil)",
            "M",
        ),
    ] = None,
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
    from labkit.runs.read.dataset import open_whole, require_snapshots

    draw = FIGURES.require(figure, "figure")
    if len(run) > 1 and not draw.several:
        raise InputError("draws one run", field="figure", value=figure, allowed="one file")
    runs = {} if draw.needs == "probes" else runs_by_name(run)
    first = open_whole(run[0], "probes") if draw.needs == "probes" else next(iter(runs.values()))
    output = output or figure_name(run[0], variable or figure)
    require_outputs(output, csv)
    if draw.needs == "snapshots":
        require_snapshots(first, run[0], [snapshot], ", or draw the figure shares")
    options: dict[str, object] = {"variable": variable, "strength": strength, "groups": groups, "snapshot": snapshot}
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


@command("picture")
def picture_command(
    file: Annotated[str, Option("state or run file")],
    *,
    snapshot: Annotated[
        list[int] | None,
        Option(
            "snapshots of a run to draw, one below the other; negative numbers count from the end (default: -1)",
            "N",
            type=int,
        ),
    ] = None,
    output: Annotated[
        str | None,
        Option(
            "picture to write (default: next to the file); FILE.html: a page with a 3D view of all snapshots", "FILE"
        ),
    ] = None,
) -> None:
    """Draws the grains (left) and the contact forces (right) in 3D.

    Writes an image, or a page for a browser with a 3D view and a slider over the snapshots.

    Examples:
        labkit picture r.run.nc --snapshot 0 -1
        labkit picture r.run.nc -o r.html
    """
    from labkit.figures import plots
    from labkit.figures.picture import draw_grains
    from labkit.figures.viewer import Viewer
    from labkit.runs.read.dataset import snapshots

    output = output or figure_name(file, "picture")
    if Path(output).suffix.lower() == ".html":
        Viewer(snapshots(file, snapshot or []), Path(file).name).write(output)
        print(f"page: {output}")
        return
    require_outputs(output, None, ".html")
    numbers = snapshot or [-1] * (labkit_kind(file) == "run")
    plots.save(draw_grains(snapshots(file, numbers), Path(file).name), output, [file])
    print(f"picture: {output}")


@command("watch")
def watch_command(
    run: Annotated[list[str], Option("run file, complete or not")],
    *,
    interval: Annotated[int, Option("time between two plots in s", "SECONDS")] = 5,
    once: Annotated[bool, Option("plot once and stop")] = False,
) -> None:
    """Plots runs in the terminal repeatedly while they are computed.

    Writes no file. Stop it with Ctrl-C.

    Example:
        labkit watch *.run.nc
    """
    from labkit.figures.watch import watch

    watch(run, interval, once)
