"""The options of the simulating commands: one set for `labkit`, `yade -n -x` and yade-batch tables."""

from __future__ import annotations

import argparse
import os
import sys

from labkit.engines import ENGINES
from labkit.errors import InputError
from labkit.dem.paths import PATHS
from labkit.dem.scene import LAWS
from labkit.dem.settings import SETTINGS
from labkit.dem.simulation import SNAPSHOTS


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line: InputError instead of usage and exit. No abbreviations of options."""

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, allow_abbrev=False, **keywords)

    def error(self, message):
        raise InputError(f"{message} (see {self.prog} --help)")


def add_engine_options(parser):
    parser.add_argument("--engine", choices=ENGINES, default="yade", help="what moves the grains (default: yade)")
    parser.add_argument("--threads", type=threads, default=1, help="threads of the engine (default: 1)")


def add_settings_options(parser):
    """Options of labkit.dem.settings: for a specimen and for a run."""
    parser.add_argument("--settings", choices=SETTINGS, help="how fast and how accurate, see results/speed_error: size "
                        "of a specimen, rate of a run, time step of both (default: standard)")  # fmt: skip
    parser.add_argument("--time-step-factor", type=float, help="time step over sqrt(m/kn) of the mean grain (default: "
                        "0.2; for a run that of its specimen)")  # fmt: skip


def add_specimen_options(parser):
    """Options of a specimen; their names are also the columns of a yade-batch table."""
    parser.add_argument("--void-ratio", type=float, help="target, overlaps not taken out, e.g. 0.67")
    parser.add_argument("--step1-friction", type=float, default=0.15, help="mu of step 1 (default: 0.15)")
    parser.add_argument("--step1-rolling-friction", type=float, default=0.1, help="mu_r of step 1 (default: 0.1)")
    add_settings_options(parser)
    parser.add_argument("--side", type=float, help="side of the cube in m (default: 4e-3)")
    parser.add_argument("--grains", type=positive_int, help="choose the side for about so many grains instead")
    parser.add_argument("--seed", type=int, default=1, help="of the random insertion (default: 1)")
    parser.add_argument("--law", choices=LAWS, default="yade", help="contact law: YADE's, or Eqs. 1-3 of the paper "
                        "(engine fused only; default: yade)")  # fmt: skip
    add_engine_options(parser)
    parser.add_argument("-o", "--output", help="state file to write (default: a name made of the "
                        "parameters)")  # fmt: skip


def add_consolidation_options(parser):
    """Options of a consolidation."""
    parser.add_argument("specimen", nargs="?", help="state file to start from")
    parser.add_argument("--pressure", type=float, help="normal stress in Pa to reach in all directions")
    add_engine_options(parser)
    parser.add_argument("-o", "--output", help="state file to write")


def add_layer_options(parser):
    """Options of the stratified layer; their names are also the columns of a yade-batch table."""
    parser.add_argument("--size-ratio", type=float, default=2.0, help="coarse over fine diameter (default: 2)")
    parser.add_argument("--width", type=float, default=30.0, help="of the layer, in coarse diameters (default: 30)")
    parser.add_argument("--height", type=float, default=30.0, help="of both strata, likewise (default: 30)")
    parser.add_argument("--pressure", type=float, default=0.1e6, help="sigma_xx in Pa (default: 0.1e6)")
    parser.add_argument("--ratio", type=float, default=2.0, help="sigma_zz/sigma_xx to reach (default: 2)")
    parser.add_argument("--seed", type=int, default=3, help="of the random insertion (default: 3)")
    add_engine_options(parser)
    parser.add_argument("-o", "--output", default="stratified.state.nc", help="state file to write (default: "
                        "stratified.state.nc)")  # fmt: skip


def add_run_options(parser):
    """Options of a run; their names are also the columns of a yade-batch table."""
    parser.add_argument("path", nargs="?", help=f"loading path: {', '.join(PATHS)}")
    parser.add_argument("specimen", nargs="?", help="state file to start from")
    parser.add_argument("--pressure", type=float, help="stress in Pa that cr, cp and cyclic_cp hold (default: the "
                        "specimen's), isoc stops at (3e6), isod stops under (20e3)")  # fmt: skip
    add_settings_options(parser)
    parser.add_argument("--strain", type=float, help="axial strain to reach (default: 0.4; isoc 0.1, isod -0.1)")
    parser.add_argument("--rate", type=float, help="axial strain rate in 1/s (default: 10; isoc 5, isod 2.5)")
    parser.add_argument("--reversals", type=strains, help="axial strains at which cyclic_cp turns, the last one ends "
                        "it, with = if the first is negative (default: 0.01,-0.01,0.02,-0.02,0.03,-0.03,0.04)")
    parser.add_argument("--record-strain", type=float, help="strain between records (default: 1e-3; isoc, isod 1e-4)")
    parser.add_argument("--snapshots", type=int, default=SNAPSHOTS, help="records kept with all contacts beside "
                        "the first; 0: none (default: 20)")  # fmt: skip
    parser.add_argument("--law", choices=LAWS, help="contact law (default: that of the specimen)")
    parser.add_argument("--save-every", type=positive_int, help="records between two saves (default: half a minute)")
    add_engine_options(parser)
    parser.add_argument("-o", "--output", help="run file to write or to go on with (default: "
                        "a name made of the parameters)")  # fmt: skip


def positive_int(text):
    value = int(text)
    if value < 1:
        raise ValueError(text)
    return value


def threads(text):
    """A number of threads that this machine can bear."""
    value, most = positive_int(text), 4 * (os.cpu_count() or 1)
    if value > most:
        raise argparse.ArgumentTypeError(f"{value} threads are too many for this machine: give at most {most}")
    return value


def strains(text):
    """0.01,-0.01,0.02 as a tuple of numbers."""
    return tuple(float(word) for word in text.strip("()[] ").split(",") if word.strip())


def parse(parser, argv):
    """Parsed options; exits through InputError, or SystemExit(0) for --help."""
    return parser.parse_args(argv)


def parse_in_yade(parser):
    """The options of a script inside YADE: of a yade-batch table where there is one, else of the command line.

    A column of the table is the name of an option with `_` for `-`; strings stand in quotes.
    """
    if not os.environ.get("YADE_BATCH"):
        return parse(parser, sys.argv[1:])
    from yade import utils

    table, _, line = os.environ["YADE_BATCH"].rpartition(":")
    row = utils.TableParamReader(table).paramDict()[int(line)]
    known = {action.dest for action in parser._actions} - {"help"}
    columns = {name: text for name, text in row.items() if name != "description" and not name.startswith("!")}
    unknown = sorted(set(columns) - known)
    if unknown:
        raise InputError(f"{table} has a column {unknown[0]!r}: use {', '.join(sorted(known))}")
    positional = [action.dest for action in parser._actions if not action.option_strings]
    values = {name: text.strip("'\"") for name, text in columns.items() if text != "*"}
    argv = [values.pop(name) for name in positional if name in values]
    for name, text in values.items():
        argv += [f"--{name.replace('_', '-')}={text}"]
    return parse(parser, argv)


def require(value, name):
    """Raises InputError when an option that has no default was not given."""
    if value is None:
        raise InputError(f"{name} is missing: give it (see --help)")
    return value
