"""Commands: where labkit's are, and how a command registers itself with its options."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
from collections.abc import Callable

# name -> (module of this room that registers it, what it does); nothing is imported before a command is asked for
LABKITS = {
    "specimen": ("simulate", "make a specimen: a state file"),
    "consolidate": ("simulate", "bring a specimen to a pressure: a state file"),
    "run": ("simulate", "take a specimen along a loading path: a run file"),
    "stratified": ("look", "coarse grains above fine ones (Fig. 3): a state file, forces and strata"),
    "verify": ("look", "compare C0 with Love's stress, check what a path holds: a table and a figure"),
    "critical": ("look", "critical state of shear tests: a table, and their e-p paths"),
    "figure": ("look", "grains, contacts, forces and records of a run: a figure and its table"),
    "picture": ("look", "grains and contact forces in three dimensions: a picture"),
    "paraview": ("look", "grains, contacts and cell as files that ParaView opens"),
    "watch": ("look", "draw runs in the terminal while they go on"),
    "export": ("export", "records of a run, or contacts of a snapshot: a CSV file"),
    "info": ("look", "what is in a state or run file"),
    "model": ("model", "C0 to C5 along a loading path, no grains: a run file"),
    "calibrate": ("model", "parameters of the model from run files"),
    "model-speed": ("model", "speed against error of the model's integrators: a table and a figure"),
    "campaign": ("campaign", "many specimens and runs from one file, here or on a cluster"),
    "bench": ("bench", "speed on one scene: a stock YADE script, labkit's engines, LAMMPS"),
    "bench-statistics": ("bench", "speed and memory of the statistics of a run"),
    "demo": ("demo", "specimen, CV test and verification in a few minutes"),
}

Options = Callable[[argparse.ArgumentParser], None]
Execute = Callable[[argparse.Namespace, list[str]], "int | None"]


@dataclasses.dataclass(frozen=True)
class Command:
    """options(parser) adds its options; execute(options, argv) returns an exit code, None for 0."""

    name: str
    help: str
    options: Options
    execute: Execute


REGISTERED: dict[str, Command] = {}


def command(name: str, options: Options, help: str = "") -> Callable[[Execute], Execute]:
    """A decorator that registers a function as a command; `help` for one that is not labkit's own."""

    def register(execute: Execute) -> Execute:
        said = help or LABKITS.get(name, ("", name))[1]
        REGISTERED[name] = Command(name, said, options, execute)
        return execute

    return register


def helps() -> dict[str, str]:
    """What every command does, name -> sentence."""
    return {name: said for name, (_, said) in LABKITS.items()} | {name: c.help for name, c in REGISTERED.items()}


def find(name: str) -> Command | None:
    """The command of that name, None for an unknown one."""
    if name not in REGISTERED and name in LABKITS:
        importlib.import_module(f"labkit.cli.{LABKITS[name][0]}")
    return REGISTERED.get(name)
