"""`labkit density` and `labkit twins`: limits of the density, relative densities, and twins of equal e and p."""

from __future__ import annotations

import argparse

from labkit.cli.arguments import add_engine_options, add_parameters, given, positive_int
from labkit.cli.look import figure_name
from labkit.cli.registry import command
from labkit.dem.scene import Scene
from labkit.dem.state import read_state, write_state
from labkit.io.files import require_writable
from labkit.io.progress import reporter
from labkit.micro.void_ratio import void_ratio_nominal


def density_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit density`."""
    parser.add_argument("specimen", metavar="SPECIMEN", nargs="*", help="state files whose relative density to print")
    parser.add_argument("--grains", type=positive_int, default=1000, metavar="N", help="per specimen (default: 1000)")
    parser.add_argument("--seeds", type=positive_int, default=3, metavar="N", help="number of specimens (default: 3)")
    add_parameters(parser.add_argument_group("material and contact law"), Scene)
    add_engine_options(parser)


@command("density", density_options)
def do_density(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints e_min, e_max and the relative densities."""
    from labkit.runs.preparation import density_limits

    states = {file: read_state(file) for file in options.specimen}
    scene = Scene(**given(options, Scene))
    limits = density_limits(
        scene,
        options.grains,
        range(1, options.seeds + 1),
        engine=options.engine,
        progress=reporter("density"),
        precision=options.precision,
    )
    for name, values in (("e_min", limits.e_min), ("e_max", limits.e_max)):
        print(f"{name} {values.mean():.4f}, from {values.min():.4f} to {values.max():.4f}")
    print(f"compressed from a gas to {limits.pressure / 1e3:g} kPa without friction, and without sliding or rolling")
    for file, state in states.items():
        e = void_ratio_nominal(state.snapshot())
        print(f"{file}: void ratio {e:.4f}, relative density {limits.relative_density(e):.0%}")


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
