"""Describes the contents of a state, run or probes file as text, and checks its hashes."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import xarray

from labkit.errors import InputError
from labkit.files.netcdf import labkit_kind, open_netcdf
from labkit.files.provenance import BESIDE, check, provenance_of, provenance_rows
from labkit.files.schema import AXES, RECORD, STATE, kind_of_bodies
from labkit.grains.laws import LAWS
from labkit.grains.scene import Scene, used_parameters
from labkit.grains.state_file import read_state
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress, largest_deviation, mean_stress
from labkit.micro.tensors import COMPONENTS, symmetric, to_six
from labkit.parameters import Values, parameters_of
from labkit.paths.registry import PATHS
from labkit.paths.step import Here
from labkit.results.compression import compression_numbers
from labkit.results.dataset import open_run
from labkit.results.endings import path_and_origin, void_ratio_at_start
from labkit.results.run import Run
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import specimen_summary

UNITS = {"time": "s", "time_step": "s", "wall_time": "s"}  # units of the attributes of a file
WIDTH = 18  # width of a label in characters


def describe_file(path: str | os.PathLike[str]) -> str:
    """Describe a labkit file in lines of text. Raises InputError for any other file."""
    kind = file_kind(path)
    if kind in ("figure", "statistics", "output"):
        return "\n".join([f"{path}: labkit {kind}", *_lines(provenance_rows(provenance_of(path) or {}))])
    lines = [f"{path}: labkit {kind} file"]
    if kind == "state":
        state = read_state(path)
        values = {name: f"{format_number(value)} {unit}" for name, (value, unit) in specimen_summary(state).items()}
        lines += ["summary", *_lines(values | stress_summary(love_stress(state.snapshot())), 24)]
    if kind == "run":
        with open_run(path) as run:
            lines += ["summary", *_lines(run_summary(run), 24)]
    lines += ["attributes"]
    with open_netcdf(path, kind) as dataset:
        attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        table = RECORD if kind == "run" else STATE | kind_of_bodies(dataset.variables).table
        further = sorted(set(dataset.variables) - set(table) - set(AXES))
        parts = (dataset, *(group for name, group in dataset.groups.items() if name != "checkpoint"))
        sizes = {name: len(d) for part in parts for name, d in part.dimensions.items()}
        groups = list(dataset.groups)
    made_by = attributes.pop("provenance", "")
    for name, value in attributes.items():
        empty = not np.any(value) if name.startswith("undrained_") else isinstance(value, str) and not value
        if not empty and name != "endings":  # e.g. there is no reason why the run ended
            lines += _attribute(name, value, attributes)
    contents = {"sizes": [f"{name} {size}" for name, size in sizes.items()], "groups": groups}
    contents["other variables"] = further
    lines += _lines({name: ", ".join(texts) for name, texts in contents.items() if texts})
    if made_by:
        lines += ["provenance", *_lines(provenance_rows(json.loads(made_by)))]
    return "\n".join(lines)


def stress_summary(stress: np.ndarray) -> dict[str, str]:
    """Return the six components of a stress (3, 3), Pa, and how far it is from isotropic, name -> text."""
    p, components = float(mean_stress(stress)), to_six(symmetric(stress)) / to_six(np.ones((3, 3)))
    values = {
        f"stress {', '.join(COMPONENTS[:3])}": f"{format_number(components[:3])} Pa",
        f"stress {', '.join(COMPONENTS[3:])}": f"{format_number(components[3:])} Pa",
    }
    if p > 0.0:
        values["q (invariant)/p"] = f"{float(equivalent_stress(stress)) / p:.2%}"
        worst, _ = largest_deviation(stress, p)
        off = components[COMPONENTS.index(worst)] - (p if worst in COMPONENTS[:3] else 0.0)
        values["farthest from isotropic"] = f"{worst}, by {off / p:.2%} of p"
    return values


def run_summary(run: xarray.Dataset) -> dict[str, str]:
    """Summarise the end of a run and, if it is undrained, its pore pressure, name -> value with unit."""
    of, strain, p, q = Run(run), run.lab.strain(), run.lab.mean_stress(), run.lab.q()
    values = {
        "path": path_and_origin(run.attrs),
        "complete": "yes" if run.attrs["complete"] else "no",
        **({"ended": "; ".join(ends)} if (ends := [*filter(None, (*of.met_conditions, of.ended_because))]) else {}),
        "grains": format_number(run.lab.number_of_grains),
        "records": format_number(run.sizes["time"]),
        strain.attrs["long_name"]: f"{float(strain[-1]):.4%}",
        "mean stress p": f"{format_number(float(p[-1]))} Pa",
        q.attrs["long_name"]: f"{format_number(float(q[-1]))} Pa",
        "q (invariant)/p": f"{float(equivalent_stress(run['stress'].values[-1]) / p[-1]):.2%}",
        "void ratio": format_number(float(run["void_ratio"][-1])),
    }
    if text := void_ratio_at_start(Recipe.made_at(run.attrs.get("recipe", "")), float(run["void_ratio_nominal"][0])):
        values["start"] = text
    with contextlib.suppress(InputError):  # not a test of compression
        values["compression"] = str(compression_numbers(run))
    start, cyclic = run.lab.undrained_stress, run.lab.path is not None and run.lab.path.cyclic
    goes_on = start is not None and not np.isclose(mean_stress(start), float(p[0]))
    if cyclic:
        cycles = format_number(float(run.lab.cycles()[-1])) + _static_shear(run)
        values["cycles"] = cycles + ", from the start of this run, which goes on from undrained loading" * goes_on
    with contextlib.suppress(InputError):  # a drained run has no r_u
        how = "u measured" if "measured_pore_pressure" in run else f"constant total {run.lab.total} stress"
        values["largest r_u"] = f"{format_number(float(run.lab.pore_pressure_ratio().max()))} ({how})"
        if start is not None and goes_on:
            values["r_u refers to"] = f"p = {format_number(float(mean_stress(start)))} Pa, before this run"
    if cyclic and run.lab.is_undrained:
        liquefaction = run.lab.liquefaction()
        values["cycles to r_u > 0.95"] = format_number(liquefaction.cycles_to_ratio)
        values["largest double amplitude"] = f"{liquefaction.largest_double_amplitude:.3%}"
        values["cycles to 5 % of it"] = format_number(liquefaction.cycles_to_double_amplitude)
    return values


def _static_shear(run: xarray.Dataset) -> str:
    """Say about which stress a cyclic test cycles; empty if this is zero, or if it cycles between strains."""
    start = Here(run["stress"].values[0], undrained=run.lab.undrained_stress)
    ends = [end for step in itertools.islice(run.lab.path.steps_from(start), 2) for end in step.stress_ends]
    static = sum(end.level for end in ends) / 2.0
    unit = "" if ends and "/" in ends[0].name else " Pa"
    return f", about {ends[0].name} = {format_number(static)}{unit}" if len(ends) == 2 and static else ""


def format_number(value: object) -> str:
    """Format a value: integers in full, other numbers with six significant digits, lists with commas."""
    if isinstance(value, (bool, str, np.bool_)) or value is None:
        return str(value)
    if isinstance(value, Mapping):  # a step of a path
        return str(value.get("label") or "step")
    if isinstance(value, Iterable):
        return ", ".join(format_number(each) for each in value)
    if isinstance(value, (int, np.integer)):
        return f"{value:d}"
    return f"{value:.6g}"


def _attribute(name: str, value: object, attributes: Values) -> list[str]:
    """Return the lines of one attribute of a file; an attribute in JSON has one line per entry."""
    entries = _entries(value)
    if entries is None:
        return _lines({name: f"{format_number(value)} {UNITS.get(name, '')}"})
    if name.endswith("provenance"):
        return [f"  {name}", *_lines(provenance_rows(entries), width=WIDTH + 4, indent=4)]
    kinds: dict[str, type] = {"scene": Scene, "recipe": Recipe}
    if attributes.get("path") in PATHS:
        kinds["path_parameters"] = PATHS[attributes["path"]]
    parameters = parameters_of(kinds[name]) if name in kinds else {}
    units = {key: parameter.unit for key, parameter in parameters.items() if parameter.unit != "1"}
    if name == "recipe" and entries.get("preparation") == "compression" and entries.get("pressure") is not None:
        entries["void_ratio"] = None  # it only determines the size: the specimen reaches another one
    if name == "scene" and entries.get("law") in LAWS:
        entries = used_parameters(entries)
    return [f"  {name}", *_lines(_flat(entries, units), width=WIDTH + 4, indent=4)]


def _flat(entries: Mapping[str, object], units: Mapping[str, str]) -> dict[str, str]:
    """Return name -> value with unit; nested entries get names with a dot."""
    flat: dict[str, str] = {}
    for name, value in entries.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": text for inner, text in _flat(value, {}).items()}
        else:
            flat[name] = "not given" if value is None else f"{format_number(value)} {units.get(name, '')}"
    return flat


def _entries(value: object) -> dict[str, object] | None:
    """Return the entries of an attribute that contains a JSON object, otherwise None."""
    if not isinstance(value, str) or not value.startswith("{"):
        return None
    try:
        return json.loads(value)
    except ValueError:
        return None


def _lines(rows: Mapping[str, str], width: int = WIDTH, indent: int = 2) -> list[str]:
    below = "\n" + " " * (indent + width + 1)  # indentation of the second and further lines of a text
    return [f"{'':{indent}}{name:<{width}} {text}".rstrip().replace("\n", below) for name, text in rows.items()]


def check_file(path: str | os.PathLike[str]) -> tuple[list[str], bool]:
    """Recompute the hashes of a file; returns (lines of text, True if all hashes match).

    Raises InputError for a file without hashes.
    """
    file_kind(path)
    verdicts = check(path)
    if not verdicts:
        raise InputError(f"{path} holds no hashes: it is unfinished, or was written by an earlier version of labkit")
    lines = [f"  {subject:<40} {verdict}" for subject, verdict in verdicts]
    return lines, all(verdict == "same" for _, verdict in verdicts)


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return the kind of a labkit file: `state`, `run`, `probes`, `statistics` (of a campaign), `figure` or `output`.

    Raises InputError for a file that labkit did not write.
    """
    if not Path(path).is_file():
        raise InputError(f"{path} does not exist: give a labkit state or run file")
    if Path(path).suffix.lower() == ".png" and provenance_of(path):
        return "figure"
    if Path(f"{path}{BESIDE}").exists():
        return "output"
    kind = labkit_kind(path)
    if kind not in ("state", "run", "probes", "statistics"):
        raise InputError(f"{path} is not a labkit file: give a state, run or probes file")
    return kind
