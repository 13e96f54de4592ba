"""`labkit probe`: small increments of strain or stress from one state, on the grains and on the constitutive model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from labkit.cli.arguments import add_engine_options, add_parameters, computation, given
from labkit.cli.model import add_model_options
from labkit.cli.naming import stem
from labkit.cli.registry import command
from labkit.cli.simulate import history_of
from labkit.dem.checkpoint import read_checkpoint
from labkit.dem.probes import Probing
from labkit.dem.state import State, read_state
from labkit.engines import require_engine
from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind, open_netcdf

if TYPE_CHECKING:
    from labkit.runs.probe_set import Probes


def probe_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit probe`."""
    parser.add_argument("file", metavar="FILE", help="state file, or run file, whose checkpoint is probed")
    add_parameters(parser.add_argument_group("probes"), Probing)
    group = parser.add_argument_group("materials", "The grains, and on request:")
    group.add_argument(
        "--elastic",
        action="store_true",
        help="also probe the grains with friction coefficients so high that no contact slides",
    )
    group.add_argument(
        "--model", action="store_true", help="also probe the constitutive model in the state that the grains have"
    )
    add_model_options(group)
    add_engine_options(parser.add_argument_group("computation"))
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="probes file to write, or a table if its name ends in .csv (default: next to FILE)",
    )


@command("probe", probe_options)
def do_probe(options: argparse.Namespace, argv: list[str]) -> None:
    """Probes the state in a file, and writes and summarises the result."""
    from labkit.io.provenance import write_with_provenance

    probing = Probing(**given(options, Probing))
    state = state_in(options.file)
    require_engine(options.engine, state.scene, options.precision)
    output = options.output or str(Path(options.file).with_name(f"{stem(options.file)}.probes.nc"))
    as_table = output.lower().endswith(".csv")
    require_writable(output, None if as_table else "probes")
    probes = probe_all(state, probing, options)
    if as_table:
        write_with_provenance(output, probes.table().to_csv(index=False, float_format="%.8g"), [options.file])
    else:
        probes.write(output, [options.file], history_of(argv))
    print(f"{output}: {probes!r}")
    print(summary_text(probes))


def summary_text(probes: Probes) -> str:
    """The summary as text, with the stiffness in MPa, or the compliance in 1/GPa."""
    name, factor, unit = ("stiffness", 1e-6, "MPa") if probes.kind == "strain" else ("compliance", 1e9, "1/GPa")
    table = probes.summary()
    for column in ("least", "largest"):
        table[column] *= factor
    names = {"least": f"least {name} ({unit})", "largest": f"largest ({unit})", "over_affine": "over affine bound"}
    names |= {"sliding_loss": "sliding loss (J/m3)", "contacts_changed": "contacts changed", "starts": "start states"}
    return table.rename(columns=names).to_string(index=False, float_format="%.3g", na_rep="-")


def probe_all(state: State, probing: Probing, options: argparse.Namespace) -> Probes:
    """The probes of all materials that the options ask for; the model first, as it may refuse the state."""
    from labkit.io.progress import reporter
    from labkit.model import probes as of_model
    from labkit.model.run_file import read_model
    from labkit.model.state import state_of
    from labkit.runs.probes import at_rest, probes_of

    start = at_rest(state, **computation(options))
    predicted = None
    if options.model:
        model = read_model(options.parameters).reading(beyond_e_cmax=options.beyond_e_cmax)
        predicted = of_model.probes_of(state_of(start.snapshot()), model, probing)
    found = probes_of(start, probing, False, progress=reporter("probes"), **computation(options))
    if options.elastic:
        found += probes_of(start, probing, True, progress=reporter("elastic probes"), **computation(options))
    return found if predicted is None else found + predicted


def state_in(file: str) -> State:
    """The State in a state file, or in the last checkpoint of a run file. Raises InputError."""
    if labkit_kind(file) != "run":
        return read_state(file)
    with open_netcdf(file, "run") as dataset:
        if "checkpoint" not in dataset.groups:
            raise InputError(f"{file} has no checkpoint: give a state file, or the run file of a simulation")
    return read_checkpoint(file)
