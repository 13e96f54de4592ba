"""The registry of commands: which modules define the built-in ones, and how a command registers itself."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
from collections.abc import Callable

# name -> (module of this package that registers it, summary); modules are imported when their command is used
LABKITS = {
    "specimen": ("simulate", "make a specimen"),
    "consolidate": ("simulate", "consolidate a specimen isotropically to a pressure"),
    "density": ("density", "measure e_min and e_max of a material, and relative densities"),
    "twins": ("density", "make a specimen with the same e and p as another, and fewer contacts"),
    "run": ("simulate", "load a specimen along a path"),
    "probe": ("probe", "probe a state with small increments of strain or stress in many directions"),
    "driver": ("driver", "carry out a test file of the Incremental Driver"),
    "stratified": ("look", "make the stratified layer of Fig. 3, coarse over fine discs"),
    "verify": ("look", "compare C0 with Love's stress and check what the path holds"),
    "critical": ("look", "tabulate the critical states of shear tests"),
    "figure": ("look", "draw a figure of a run"),
    "picture": ("look", "draw the grains and the force chains in 3D"),
    "paraview": ("look", "write grains, contacts and cell for ParaView"),
    "grading": ("grading", "compare the size distribution of the grains with the grading of the scene"),
    "watch": ("look", "plot runs in the terminal while they are computed"),
    "import": ("exchange", "make a specimen from a file of another program"),
    "export": ("export", "write tables, or files for other programs"),
    "statistics": ("exchange", "compute the statistics of a contact list, without a simulation"),
    "info": ("look", "show the contents and the origin of a file"),
    "model": ("model", "integrate the constitutive model along a loading path"),
    "calibrate": ("model", "fit the parameters of the model to runs"),
    "model-speed": ("model", "measure time and error of the model's integrators"),
    "umat": ("umat", "write the model as a material law for finite-element programs (UMAT, MGIS)"),
    "umat-speed": ("umat", "measure the speed of the compiled material law"),
    "campaign": ("campaign", "carry out many runs defined in one file"),
    "bench": ("bench", "compare the speed of YADE, labkit's engines and LAMMPS"),
    "bench-statistics": ("bench", "measure the speed and memory of the statistics of a run"),
    "demo": ("demo", "make a specimen, test it and verify the test, in a few minutes"),
}

Options = Callable[[argparse.ArgumentParser], None]
Execute = Callable[[argparse.Namespace, list[str]], "int | None"]


@dataclasses.dataclass(frozen=True)
class Command:
    """A command. options(parser) adds its options; execute(options, argv) returns an exit code, or None for 0."""

    name: str
    help: str
    options: Options
    execute: Execute


REGISTERED: dict[str, Command] = {}


def command(name: str, options: Options, help: str = "") -> Callable[[Execute], Execute]:
    """A decorator that registers a function as a command; `help`: its summary, unless the command is built in."""

    def register(execute: Execute) -> Execute:
        summary = help or LABKITS.get(name, ("", name))[1]
        REGISTERED[name] = Command(name, summary, options, execute)
        return execute

    return register


def helps() -> dict[str, str]:
    """Summary of every command, name -> text."""
    own = {name: summary for name, (_, summary) in LABKITS.items()}
    return own | {name: command.help for name, command in REGISTERED.items()}


def find(name: str) -> Command | None:
    """The command of that name, or None if it is unknown."""
    if name not in REGISTERED and name in LABKITS:
        importlib.import_module(f"labkit.cli.{LABKITS[name][0]}")
    return REGISTERED.get(name)
