"""`labkit density` and `labkit twins`: limits of the density, relative densities, and twins of equal e and p."""

from __future__ import annotations

import argparse

from labkit.cli.arguments import add_engine_options, add_parameters, given, positive_int
from labkit.cli.look import figure_name
from labkit.cli.registry import command
from labkit.dem.scene import Scene
from labkit.dem.state import read_state, write_state
from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind, open_netcdf
from labkit.io.progress import reporter
from labkit.io.provenance import write_with_provenance
from labkit.micro.void_ratio import void_ratio_nominal


def density_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit density`."""
    parser.add_argument(
        "specimen", metavar="SPECIMEN", nargs="*", help="state files, or run files, whose first record counts"
    )
    parser.add_argument("--grains", type=positive_int, default=1000, metavar="N", help="per specimen (default: 1000)")
    parser.add_argument("--seeds", type=positive_int, default=3, metavar="N", help="number of specimens (default: 3)")
    parser.add_argument("--csv", metavar="FILE", help="also write the table as CSV, to this file")
    add_parameters(parser.add_argument_group("material and contact law"), Scene)
    add_engine_options(parser)


@command("density", density_options)
def do_density(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints e_min, e_max and the relative densities."""
    from labkit.runs.preparation import density_limits

    if options.csv:
        require_writable(options.csv)
    void_ratios = {file: _void_ratio(file) for file in options.specimen}
    scene = Scene(**given(options, Scene))
    limits = density_limits(
        scene,
        options.grains,
        range(1, options.seeds + 1),
        engine=options.engine,
        progress=reporter("density"),
        precision=options.precision,
    )
    table = limits.table(void_ratios)
    print(table.to_string(index=False, na_rep="", float_format="%.4f"))
    print(
        f"nominal void ratios; +-: 95 % intervals from {options.seeds} specimens of {options.grains} grains each, "
        f"compressed from a gas to {limits.pressure / 1e3:g} kPa, without friction (e_min) or with that of the material"
    )
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), options.specimen)


def _void_ratio(file: str) -> float:
    """Nominal void ratio of a specimen: of a state file, or of the first record of a run file."""
    if labkit_kind(file) != "run":
        return void_ratio_nominal(read_state(file).snapshot())
    with open_netcdf(file, "run") as dataset:
        if "void_ratio_nominal" not in dataset.variables or not len(dataset.dimensions["time"]):
            raise InputError("has no record of the void ratio: give the state file", field="SPECIMEN", value=file)
        return float(dataset["void_ratio_nominal"][0])


def twins_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit twins`."""
    parser.add_argument("specimen", metavar="SPECIMEN", help="state file, compressed without friction")
    add_engine_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="state file of the second twin")


@command("twins", twins_options)
def do_twins(options: argparse.Namespace, argv: list[str]) -> None:
    """Makes the second of two specimens with equal e and p and different Z."""
    from labkit.runs.preparation import make_twins

    output = options.output or figure_name(options.specimen, "twin").removesuffix(".png") + ".state.nc"
    require_writable(output, "state")
    twins = make_twins(read_state(options.specimen), options.engine, reporter("twins"), options.precision)
    write_state(output, twins.second)
    e, p, Z = twins.differences()
    print(f"{output}: one cycle of {twins.amplitude:.2%}; void ratio {e:+.5f}, pressure {p:+.3%}, Z {Z:+.2f}")
