"""`labkit verify`, `critical`, `figure`, `picture`, `paraview`, `watch` and `info`: views of runs and specimens."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labkit.cli.arguments import one_of, positive_int
from labkit.cli.naming import stem
from labkit.cli.parser import Parser, listed, summary_of
from labkit.cli.registry import command
from labkit.cli.simulate import layer_options, stratified
from labkit.errors import InputError
from labkit.io.files import make_folder, require_writable
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_with_provenance
from labkit.runs.figures import FIGURES

if TYPE_CHECKING:
    import xarray


def verify_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit verify`."""
    parser.add_argument("run", metavar="RUN", nargs="+", help="run file")
    _add_figure_output(parser, "next to the first run file")
    parser.add_argument(
        "--rows", type=positive_int, metavar="N", default=20, help="number of rows of the table (default: 20)"
    )
    _add_csv(parser, "the checks and limits")


@command("verify", verify_options)
def do_verify(options: argparse.Namespace, argv: list[str]) -> int:
    """Prints the checks of each run and draws them; returns 1 if a check fails."""
    from labkit.runs import verify
    from labkit.visuals import plots

    runs = open_runs(options.run)
    verify.require_contacts(runs)
    figure = options.output or figure_name(options.run[0], "verify")
    require_outputs(figure, options.csv)
    findings = {name: verify.findings(run) for name, run in runs.items()}
    for name, run in runs.items():
        print(
            f"{name}: path {run.attrs['path']}, {run.sizes['grain']} grains, {run.sizes['time']} records"
            + ("" if run.attrs["complete"] else ", not complete yet")
        )
        print(verify.table(run, options.rows))
        print(*findings[name], sep="\n")
    plots.save(plots.sff_against_love(runs), figure, options.run)
    print(f"figure: {figure}")
    if options.csv:
        write_with_provenance(options.csv, verify.findings_csv(findings), options.run)
    return 0 if all(f.holds for lines in findings.values() for f in lines if f.decides) else 1


def _add_figure_output(parser: argparse.ArgumentParser, place: str, default: str | None = None) -> None:
    parser.add_argument("-o", "--output", metavar="FILE", default=default, help=f"figure to write (default: {place})")


def _add_csv(parser: argparse.ArgumentParser, content: str = "the table") -> None:
    parser.add_argument("--csv", metavar="FILE", help=f"also write {content} as CSV, to this file")


def critical_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit critical`."""
    parser.add_argument("run", metavar="RUN", nargs="+", help="run file")
    parser.add_argument(
        "--min-strain",
        type=float,
        metavar="STRAIN",
        help="strain that a test must reach to be included: gamma_xz in simple shear, else axial (default: 0.15)",
    )
    _add_figure_output(parser, "critical.png", "critical.png")
    _add_csv(parser)


@command("critical", critical_options)
def do_critical(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints the table of critical states and draws the e-p and q-p paths."""
    from labkit.runs.critical import ENOUGH_STRAIN, critical_states, mean_strengths, require_critical
    from labkit.visuals import plots

    opened, min_strain = open_runs(options.run), ENOUGH_STRAIN if options.min_strain is None else options.min_strain
    runs, left_out = require_critical(opened, min_strain)
    files = [file for file, name in zip(options.run, opened, strict=True) if name in runs]
    require_outputs(options.output, options.csv)
    print(*(f"left out: {name}: {reason}\n" for name, reason in left_out.items()), sep="", end="")
    table = critical_states(runs)
    print(table.to_string(index=False, float_format="%.4g"))
    print(*mean_strengths(runs, table), sep="\n")
    plots.save(plots.e_p_paths(runs, list_runs=True), options.output, files)
    print(f"figure: {options.output}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), files)


def figure_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit figure`."""
    parser.add_argument("figure", metavar="FIGURE", type=one_of(FIGURES), help=f"one of {', '.join(FIGURES)}")
    parser.add_argument(
        "run",
        metavar="RUN",
        nargs="+",
        help="run file; several for stress_path, pi_plane, shear, cycles and test; a probes file for envelope",
    )
    parser.add_argument("--variable", help="recorded variable to draw (figure `records` only)")
    parser.add_argument(
        "--strength",
        type=float,
        metavar="M",
        help="q/p in triaxial compression (figures `stress_path` and `pi_plane` only; default: that of the compression "
        "tests drawn, else that of Table 2)",
    )
    parser.add_argument(
        "--groups", type=positive_int, metavar="N", default=5, help="number of grain-size groups (default: 5)"
    )
    parser.add_argument(
        "--snapshot",
        type=int,
        metavar="N",
        default=-1,
        help="number of the snapshot; a negative number counts from the end (default: -1)",
    )
    _add_figure_output(parser, "next to the run file")
    _add_csv(parser)
    if isinstance(parser, Parser) and {"-h", "--help"} & set(parser.command_line):  # needs matplotlib
        parser.epilog = listed("figure", {name: summary_of(FIGURES[name]) for name in FIGURES})


@command("figure", figure_options)
def do_figure(options: argparse.Namespace, argv: list[str]) -> None:
    """Draws a figure of runs or of probes, and prints its table or writes it as CSV."""
    import labkit
    from labkit.runs.dataset import require_snapshots
    from labkit.visuals import plots

    draw = FIGURES.require(options.figure, "figure")
    of_probes, of_records, of_runs = (getattr(draw, name, False) for name in ("of_probes", "of_records", "of_runs"))
    if len(options.run) > 1 and not of_runs:
        raise InputError("draws one run", field="figure", value=options.figure, allowed="one file")
    runs = {} if of_probes else open_runs(options.run)
    run = labkit.open_probes(options.run[0]).data if of_probes else next(iter(runs.values()))
    output = options.output or figure_name(options.run[0], options.variable or options.figure)
    require_outputs(output, options.csv)
    if not (of_records or of_probes):
        require_snapshots(run, options.run[0], [options.snapshot], ", or draw the figure shares")
    keywords = _keywords(options, draw)
    figure, table = draw(runs if len(runs) > 1 else run, options.groups, options.snapshot, **keywords)
    if len(runs) == 1:
        plots.name_run(figure, run)  # a figure of the user may not name its run
    plots.save(figure, output, options.run)
    print(f"figure: {output}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), options.run)
    else:
        print(table.to_string(index=False, float_format="%.4g", max_rows=30))


def _keywords(options: argparse.Namespace, draw: Any) -> dict[str, Any]:
    """Options for this figure only. Raises InputError if the figure does not have an option that was given."""
    given = {name: value for name in ("variable", "strength") if (value := getattr(options, name)) is not None}
    for name, value in given.items():
        if name not in inspect.signature(draw).parameters:
            figures = ", ".join(each for each in FIGURES if name in inspect.signature(FIGURES[each]).parameters)
            problem = f"does not apply to the figure {options.figure}, only to {figures}: leave it out"
            raise InputError(problem, field=name, value=value)
    return given


def picture_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit picture`."""
    parser.add_argument("file", metavar="FILE", help="state or run file")
    parser.add_argument(
        "--snapshot",
        type=int,
        metavar="N",
        nargs="+",
        help="snapshots of a run to draw, one below the other; negative numbers count from the end (default: -1)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="picture to write (default: next to the file); FILE.html: a page with a 3D view of all snapshots",
    )


@command("picture", picture_options)
def do_picture(options: argparse.Namespace, argv: list[str]) -> None:
    """Draws the grains and contact forces of snapshots."""
    from labkit.runs.dataset import snapshots
    from labkit.visuals import plots
    from labkit.visuals.picture import picture
    from labkit.visuals.viewer import Viewer

    output = options.output or figure_name(options.file, "picture")
    if Path(output).suffix.lower() == ".html":
        Viewer(snapshots(options.file, options.snapshot or []), Path(options.file).name).write(output)
        print(f"page: {output}")
        return
    require_outputs(output, None, ".html")
    numbers = options.snapshot or [-1] * (labkit_kind(options.file) == "run")
    plots.save(picture(snapshots(options.file, numbers), Path(options.file).name), output, [options.file])
    print(f"picture: {output}")


def paraview_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit paraview`."""
    parser.add_argument("file", metavar="FILE", help="state or run file")
    parser.add_argument(
        "--snapshot",
        type=int,
        metavar="N",
        nargs="+",
        help="snapshots of a run to write; negative numbers count from the end (default: all)",
    )
    parser.add_argument("-o", "--output", metavar="FOLDER", help="folder to write to (default: next to the file)")


@command("paraview", paraview_options)
def do_paraview(options: argparse.Namespace, argv: list[str]) -> None:
    """Writes snapshots as files for ParaView."""
    from labkit.runs.dataset import snapshots
    from labkit.visuals import paraview

    paraview.require_meshio()
    chosen = snapshots(options.file, options.snapshot or ())
    folder = make_folder(options.output or str(Path(figure_name(options.file, "paraview")).with_suffix("")), "-o")
    print(*paraview.write_series(chosen, folder), paraview.HINT, sep="\n")


def stratified_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit stratified`."""
    layer_options(parser)
    parser.add_argument("--figure", metavar="FILE", help="figure to write (default: next to the state file)")
    _add_csv(parser)


@command("stratified", stratified_options)
def do_stratified(options: argparse.Namespace, argv: list[str]) -> None:
    """Makes the layer, draws it and prints a table of its strata."""
    import dataclasses

    import pandas

    from labkit.cli.simulate import history_of
    from labkit.dem.state import read_state
    from labkit.dem.stratified import strata
    from labkit.visuals import layer_figure, plots

    figure = options.figure or options.output.removesuffix(".state.nc") + ".png"
    require_outputs(figure, options.csv)
    stratified(options, history_of(argv))
    state = read_state(options.output)
    table = pandas.DataFrame([dataclasses.asdict(stratum) for stratum in strata(state)])
    plots.save(layer_figure.stratified_layer(state), figure, [options.output])
    print(table.T.to_string(header=False))
    print(f"figure: {figure}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), [options.output])


def watch_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit watch`."""
    parser.add_argument("run", metavar="RUN", nargs="+", help="run file, complete or not")
    parser.add_argument(
        "--interval", type=positive_int, metavar="SECONDS", default=5, help="time between two plots in s (default: 5)"
    )
    parser.add_argument("--once", action="store_true", help="plot once and stop")


@command("watch", watch_options)
def do_watch(options: argparse.Namespace, argv: list[str]) -> None:
    """Plots runs in the terminal."""
    from labkit.visuals.watch import watch

    watch(options.run, options.interval, options.once)


def info_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit info`."""
    parser.add_argument("file", metavar="FILE", help="state file, run file, or any other file that labkit wrote")
    parser.add_argument("--check", action="store_true", help="recompute the hashes of its data and of its input files")


@command("info", info_options)
def do_info(options: argparse.Namespace, argv: list[str]) -> int:
    """Prints the contents and origin of a file; returns 1 if a hash does not match."""
    from labkit.runs.info import check_file, describe_file

    print(describe_file(options.file))
    if options.check:
        lines, same = check_file(options.file)
        print("hashes", *lines, sep="\n")
        return 0 if same else 1
    return 0


def open_runs(files: Sequence[str]) -> dict[str, xarray.Dataset]:
    """Name -> run, in command-line order. Names are file names, or full paths where two file names are the same."""
    import labkit

    short = [Path(file).name.removesuffix(".run.nc") for file in files]
    names = short if len(set(short)) == len(short) else files
    return {name: labkit.open_run(file) for name, file in zip(names, files, strict=True)}


def require_outputs(figure: str, csv: str | None, *other: str) -> None:
    """Raises InputError if the figure, or the CSV file that was asked for, cannot be written; other: formats."""
    from labkit.visuals.plots import require_format

    require_format(figure, *other)
    require_writable(figure)
    if csv:
        require_writable(csv)
        if Path(csv).resolve() == Path(figure).resolve():
            raise InputError(f"{csv} is given as both the figure and the CSV file: use two different names")


def figure_name(run: str, what: str) -> str:
    """Name of a figure in the folder of a run, state or probes file."""
    return str(Path(run).with_name(f"{stem(run)}.{what}.png"))
