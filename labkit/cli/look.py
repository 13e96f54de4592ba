"""`labkit verify`, `critical`, `figure`, `picture`, `paraview`, `watch` and `info`: to look at runs and specimens."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from labkit.cli.arguments import positive_int
from labkit.cli.registry import command
from labkit.cli.simulate import layer_options, stratified
from labkit.errors import InputError
from labkit.io.files import labkit_kind, make_folder, require_writable
from labkit.io.provenance import write_with_provenance
from labkit.runs.figures import FIGURES

if TYPE_CHECKING:
    import xarray


def verify_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit verify`."""
    parser.add_argument("run", nargs="+", help="run files")
    parser.add_argument("-o", "--output", help="figure (default: beside the first run file)")
    parser.add_argument("--rows", type=positive_int, default=20, help="rows of the table (default: 20)")
    parser.add_argument("--csv", help="file for the checks and limits as CSV")


@command("verify", verify_options)
def do_verify(options: argparse.Namespace, argv: list[str]) -> int:
    """Returns 1 when a check fails."""
    from labkit.runs import verify
    from labkit.visuals import plots

    runs = open_runs(options.run)
    verify.require_contacts(runs)
    figure = options.output or figure_name(options.run[0], "verify")
    require_outputs(figure, options.csv)
    found = {name: verify.findings(run) for name, run in runs.items()}
    for name, run in runs.items():
        print(
            f"{name}: path {run.attrs['path']}, {run.sizes['grain']} grains, {run.sizes['time']} records"
            + ("" if run.attrs["complete"] else ", not complete yet")
        )
        print(verify.table(run, options.rows))
        print(*found[name], sep="\n")
    plots.save(plots.sff_against_love(runs), figure, options.run)
    print(f"figure: {figure}")
    if options.csv:
        write_with_provenance(options.csv, verify.findings_csv(found), options.run)
    return 0 if all(f.holds for lines in found.values() for f in lines if f.decides) else 1


def critical_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit critical`."""
    parser.add_argument("run", nargs="+", help="run files")
    parser.add_argument("-o", "--output", default="critical.png", help="figure (default: critical.png)")
    parser.add_argument("--csv", help="file for the table as CSV")


@command("critical", critical_options)
def do_critical(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints the table of critical states and draws the e-p paths."""
    from labkit.runs.critical import critical_states, is_shear
    from labkit.visuals import plots

    runs = open_runs(options.run)
    require_outputs(options.output, options.csv)
    runs = {name: run for name, run in runs.items() if is_shear(run)}
    if not runs:
        raise InputError("none of these runs is a shear test: give runs of cv, cr, cp, or of another path of shear")
    table = critical_states(runs)
    print(table.to_string(index=False, float_format="%.4g"))
    scatter = f" +- {table['M'].std():.3f} between tests" if len(table) > 1 else ""
    print(f"M of all: {table['M'].mean():.3f}{scatter} (paper: 0.92)")
    plots.save(plots.e_p_paths(runs), options.output, options.run)
    print(f"figure: {options.output}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), options.run)


def figure_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit figure`."""
    parser.add_argument("figure", metavar="FIGURE", choices=tuple(FIGURES), help=", ".join(FIGURES))
    parser.add_argument("run", help="run file")
    parser.add_argument("--variable", help="of the figure `records`: which recorded variable")
    parser.add_argument("--groups", type=positive_int, default=5, help="size groups (default: 5)")
    parser.add_argument("--snapshot", type=int, default=-1, help="which one, from the end if negative (default: -1)")
    parser.add_argument("-o", "--output", help="figure (default: beside the run file)")
    parser.add_argument("--csv", help="file for the table as CSV")


@command("figure", figure_options)
def do_figure(options: argparse.Namespace, argv: list[str]) -> None:
    """Draws a figure of a run; its table goes to a CSV file or is printed."""
    import labkit
    from labkit.runs.dataset import require_snapshots
    from labkit.visuals import plots

    run = labkit.open_run(options.run)
    draw = FIGURES.require(options.figure, "figure")
    of_records = getattr(draw, "of_records", False)
    output = options.output or figure_name(options.run, options.variable or options.figure)
    require_outputs(output, options.csv)
    if not of_records:
        require_snapshots(run, options.run, [options.snapshot], ", or draw its shares")
    more = {"variable": options.variable} if options.variable is not None else {}
    if more and "variable" not in inspect.signature(draw).parameters:
        raise InputError(
            f"is for the figure records, not for {options.figure}: leave it out",
            field="variable",
            value=options.variable,
        )
    figure, table = draw(run, options.groups, options.snapshot, **more)
    plots.save(figure, output, [options.run])
    print(f"figure: {output}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), [options.run])
    else:
        print(table.to_string(index=False, float_format="%.4g", max_rows=30))


def picture_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit picture`."""
    parser.add_argument("file", help="state or run file")
    parser.add_argument(
        "--snapshot",
        type=int,
        nargs="+",
        help="of a run: which ones, one below the other, from the end if negative (default: -1)",
    )
    parser.add_argument("-o", "--output", help="picture (default: beside the file)")


@command("picture", picture_options)
def do_picture(options: argparse.Namespace, argv: list[str]) -> None:
    """Draws the grains and contact forces of snapshots."""
    from labkit.runs.dataset import snapshots
    from labkit.visuals import plots
    from labkit.visuals.picture import picture

    output = options.output or figure_name(options.file, "picture")
    require_outputs(output, None)
    numbers = options.snapshot or [-1] * (labkit_kind(options.file) == "run")
    plots.save(picture(snapshots(options.file, numbers)), output, [options.file])
    print(f"picture: {output}")


def paraview_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit paraview`."""
    parser.add_argument("file", help="state or run file")
    parser.add_argument(
        "--snapshot", type=int, nargs="+", help="of a run: which ones, from the end if negative (default: all)"
    )
    parser.add_argument("-o", "--output", help="folder (default: beside the file)")


@command("paraview", paraview_options)
def do_paraview(options: argparse.Namespace, argv: list[str]) -> None:
    """Writes the files of snapshots that ParaView opens."""
    from labkit.runs.dataset import snapshots
    from labkit.visuals import paraview

    paraview.require_meshio()
    found = snapshots(options.file, options.snapshot or ())
    folder = make_folder(options.output or str(Path(figure_name(options.file, "paraview")).with_suffix("")), "-o")
    print(*paraview.write_series(found, folder), paraview.HINT, sep="\n")


def stratified_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit stratified`."""
    layer_options(parser)
    parser.add_argument("--figure", help="figure (default: beside the state file)")
    parser.add_argument("--csv", help="file for the table as CSV")


@command("stratified", stratified_options)
def do_stratified(options: argparse.Namespace, argv: list[str]) -> None:
    """Makes the layer, draws it and prints its strata."""
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
    parser.add_argument("run", nargs="+", help="run files")
    parser.add_argument("--interval", type=positive_int, default=5, help="seconds between two drawings")
    parser.add_argument("--once", action="store_true", help="draw once")


@command("watch", watch_options)
def do_watch(options: argparse.Namespace, argv: list[str]) -> None:
    """Draws runs in the terminal."""
    from labkit.visuals.watch import watch

    watch(options.run, options.interval, options.once)


def info_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit info`."""
    parser.add_argument("file")
    parser.add_argument("--check", action="store_true", help="recompute the hashes of its data and of its inputs")


@command("info", info_options)
def do_info(options: argparse.Namespace, argv: list[str]) -> int:
    """Returns 1 when a hash is not that of the data."""
    from labkit.runs.info import check_file, describe_file

    print(describe_file(options.file))
    if options.check:
        lines, same = check_file(options.file)
        print("hashes", *lines, sep="\n")
        return 0 if same else 1
    return 0


def open_runs(files: Sequence[str]) -> dict[str, xarray.Dataset]:
    """Name -> run, in the order of the command line; the name is as short as tells the files apart."""
    import labkit

    short = [Path(file).name.removesuffix(".run.nc") for file in files]
    names = short if len(set(short)) == len(short) else files
    return {name: labkit.open_run(file) for name, file in zip(names, files, strict=True)}


def require_outputs(figure: str, csv: str | None) -> None:
    """Raises InputError unless the figure and the CSV file, if one is wanted, can be written."""
    from labkit.visuals.plots import FORMATS

    if Path(figure).suffix.lower() not in FORMATS:
        raise InputError(f"{figure} has no ending of a figure: use one of {', '.join(FORMATS)}")
    require_writable(figure)
    if csv:
        require_writable(csv)
        if Path(csv).resolve() == Path(figure).resolve():
            raise InputError(f"{csv} is named for the figure and for the CSV: give two names")


def figure_name(run: str, what: str) -> str:
    """A name beside a run or state file."""
    name = Path(run).name.removesuffix(".run.nc").removesuffix(".state.nc")
    return str(Path(run).with_name(f"{name}.{what}.png"))
