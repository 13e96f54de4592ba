"""What needs contacts, which the reduced run files lack: stresses of size groups, fits of the force, the gallery."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr

import labkit as lk
from analysis.campaigns import write_tables
from analysis.netcdf import write_data
from analysis.paper.drawing import STYLE
from analysis.paper.figures import DPI
from analysis.paper.force_fits import draw_force_fits, force_fits, printed_force
from analysis.pictures import save
from labkit.errors import InputError
from labkit.figures import draw_grains

PICTURED = "cv-dense"  # run of Fig. 2, and of gallery.png at its start and end
FITTED = ("cp_500kPa-loose", PICTURED)
SIZE_GROUPS = "size_groups.nc"
GROUPS = 5  # of grain sizes, as in the paper


def write_contacts(files: Sequence[Path], folder: Path, command: str) -> None:
    """Writes the results that need contacts into a folder, from full run files; those of absent runs stay."""
    fitted = [file for name in FITTED for file in files if file.name == f"{name}.run.nc"]
    runs = {file.name.removesuffix(".run.nc"): lk.open_run(file) for file in fitted}
    if runs:
        tables = {"force_fits": force_fits(runs), "printed_force": printed_force(runs)}
        write_tables(tables, folder, fitted, command, "%.6g")
        with plt.rc_context(STYLE):
            figure = draw_force_fits(runs)
        save(figure, folder / "force_fits.png", fitted, command, DPI)
    if PICTURED in runs:
        write_size_groups(runs[PICTURED], folder, command)
        ends = runs[PICTURED].lab.snapshots([0, -1])
        save(draw_grains(ends), folder / "gallery.png", [fitted[-1]], command)
    for run in runs.values():
        run.close()


def write_size_groups(run: xr.Dataset, folder: str | Path, command: str | None = None) -> None:
    """Writes the data of Fig. 2 for a run with snapshots into a folder: run.lab.size_groups and Love's stress `love`.

    Raises InputError for a run without snapshots.
    """
    source, file = run.encoding["source"], Path(folder) / SIZE_GROUPS
    if not run.sizes["snapshot"]:
        raise InputError(f"{source} contains no contacts: use a run with snapshots")
    groups = run.lab.size_groups(GROUPS).assign(love=run.lab.love_stress()).drop_vars(["i", "j"])
    groups.attrs = {"path": run.attrs["path"]}
    write_data(file, groups, command, [source])


def read_size_groups(folder: str | Path) -> xr.Dataset | None:
    """Dataset written by write_size_groups in a folder, or None if the file is missing."""
    file = Path(folder) / SIZE_GROUPS
    return xr.load_dataset(file) if file.exists() else None
