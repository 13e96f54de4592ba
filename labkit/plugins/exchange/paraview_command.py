"""`labkit paraview`: grains, contacts and cell for ParaView."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import Option
from labkit.cli.outputs import figure_name
from labkit.cli.registry import command
from labkit.files.atomic import require_no_link
from labkit.files.writable import make_folder
from labkit.plugins.exchange.paraview import HINT, require_h5py, write_series


@command("paraview")
def paraview_command(
    file: Annotated[str, Option("state or run file")],
    *,
    snapshot: Annotated[
        list[int] | None,
        Option("snapshots of a run to write; negative numbers count from the end (default: all)", "N", type=int),
    ] = None,
    output: Annotated[str | None, Option("folder to write to (default: next to the file)", "FOLDER")] = None,
) -> None:
    """Writes grains, contacts and cell of all snapshots into one file that ParaView opens, snapshots.vtkhdf.

    Example:
        labkit paraview r.run.nc -o r_paraview
    """
    from labkit.results.dataset import snapshots

    require_h5py()
    chosen = snapshots(file, snapshot)
    default = str(Path(figure_name(file, "paraview")).with_suffix(""))
    if output is None:
        require_no_link(default)
    folder = make_folder(output or default, "-o")
    print(write_series(chosen, Path(folder) / "snapshots.vtkhdf"), HINT, sep="\n")
