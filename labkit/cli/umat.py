"""`labkit umat` and `umat-speed`: the constitutive model as a material law for finite-element programs."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from labkit.cli.arguments import add_parameters, given
from labkit.cli.model import BEYOND
from labkit.cli.registry import command
from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.provenance import write_with_provenance
from labkit.parameters import UNITS, check_parameters, parameter


@dataclasses.dataclass(frozen=True)
class Point:
    """What a point starts from if the finite-element program gives no state, and the accuracy."""

    void_ratio: float | None = parameter(None, above=0.0, help="initial void ratio of points without a state")
    pressure: float | None = parameter(
        None, unit="Pa", above=0.0, help="initial isotropic pressure of points without an initial stress"
    )
    tolerance: float = parameter(1e-4, low=1e-12, high=1.0, help="relative error allowed in one substep")

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)


def umat_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit umat`."""
    parser.add_argument("-o", "--output", metavar="FOLDER", required=True, help="folder to write, made if missing")
    parser.add_argument("--build", action="store_true", help="also compile the sources, with gfortran and gcc")
    parser.add_argument(
        "--parameters", metavar="FILE", help="parameters of the model, from labkit calibrate -o (default: Table 2)"
    )
    parser.add_argument(
        "--beyond-e-cmax",
        choices=BEYOND,
        default="error",
        help="for void ratios above e_cmax: cut the increment (default), or use flat lines, Z^c = 4 and Lambda^c = 0",
    )
    parser.add_argument(
        "--stress-unit",
        choices=tuple(UNITS["Pa"]),
        default="Pa",
        help="unit of stress of the finite-element analysis (default: Pa)",
    )
    add_parameters(parser.add_argument_group("points of the finite-element analysis"), Point)


@command("umat", umat_options)
def do_umat(options: argparse.Namespace, argv: list[str]) -> None:
    """Writes the sources and the table of PROPS, and compiles them if asked. Raises InputError, PhysicsError."""
    from labkit.model.run_file import read_model
    from labkit.model.state import require_density
    from labkit.umat.export import write
    from labkit.umat.library import build
    from labkit.umat.props import Start, properties

    point = Point(**given(options, Point))
    model = read_model(options.parameters).reading(beyond_e_cmax=options.beyond_e_cmax)
    if point.void_ratio is not None:
        require_density(model, point.void_ratio)
    start = Start(point.void_ratio or 0.0, point.pressure or 0.0)
    props = properties(model, start, point.tolerance, UNITS["Pa"][options.stress_unit])
    folder = Path(options.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = write(folder, props)
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror}): choose another --output") from None
    if options.build:
        files.append(build(folder))
    for file in files:
        print(f"written: {file}")


def speed_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit umat-speed`."""
    parser.add_argument("-o", "--output", metavar="FILE", help="also write the table to this text file")


@command("umat-speed", speed_options)
def do_umat_speed(options: argparse.Namespace, argv: list[str]) -> None:
    """Measures the updates per second of the law in Python and of the compiled law, and prints the table."""
    from labkit.bench.points import measure, text_of
    from labkit.model.parameters import Model

    if options.output:
        require_writable(options.output)
    text = text_of(measure(Model()))
    print(text)
    if options.output:
        write_with_provenance(options.output, text + "\n")
