"""`labkit density`: e_min, e_max and relative density."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from labkit.cli.arguments import Csv, Instance, Option, Working
from labkit.cli.outputs import write_table
from labkit.cli.registry import command
from labkit.errors import InputError
from labkit.files.netcdf import labkit_kind, open_netcdf
from labkit.files.writable import require_writable
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.process.progress import reporter


@command("density")
def density_command(
    specimen: Annotated[Sequence[str], Option("state files, or run files, which stand for their first record")] = (),
    *,
    grains: Annotated[int, Option("per specimen")] = 1000,
    seeds: Annotated[int, Option("number of specimens")] = 3,
    csv: Csv = None,
    scene: Annotated[Scene, Instance(Scene, "material and contact law")],
    computation: Working,
) -> None:
    """Makes the loosest and the densest specimen of the material by a stated protocol.

    Prints e_min, e_max and the relative density of the specimen.

    Example:
        labkit density s.state.nc
    """
    from labkit.plugins.densities.preparation import density_limits

    if csv:
        require_writable(csv)
    void_ratios = {file: _void_ratio(file) for file in specimen}
    limits = density_limits(scene, grains, seeds=seeds, engine=computation, progress=reporter("density"))
    print(*(f"{sentence}\n" for sentence in limits.left_out), sep="", end="")
    table = limits.table(void_ratios)
    print(table.to_string(index=False, na_rep="", float_format="%.4f"))
    interval = f"+-: 95 % intervals from {seeds} specimens" if seeds > 1 else "no interval, for one specimen"
    print(
        f"nominal void ratios; {interval} of {grains} grains each, compressed from a gas to {limits.pressure / 1e3:g} "
        "kPa, without friction (e_min) or with that of the material"
    )
    write_table(table, csv, specimen)


def _void_ratio(file: str) -> float:
    """Return the nominal void ratio of a state file, or of the first record of a run file."""
    if labkit_kind(file) != "run":
        return void_ratio_nominal(read_state(file).snapshot())
    with open_netcdf(file, "run") as dataset:
        if "void_ratio_nominal" not in dataset.variables or not len(dataset.dimensions["time"]):
            raise InputError("has no record of the void ratio: give the state file", field="SPECIMEN", value=file)
        return float(dataset["void_ratio_nominal"][0])
