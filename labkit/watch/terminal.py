"""A live view of runs in the terminal: q against strain, e against p, and the error of C0, redrawn at intervals.

Every save replaces the run file atomically, so a run can be read while it is being written.
"""

from __future__ import annotations

import shutil
import string
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray
from xarray.backends import NetCDF4DataStore

from labkit.io.extras import require_library
from labkit.io.interruption import is_being_written
from labkit.io.library import LIBRARY
from labkit.io.netcdf import open_netcdf
from labkit.runs.read.dataset import short_names

SHOWN = ("stress", "stress_sff", "void_ratio", "strain", "axial_strain")
FIRST_MARKS = "*o+x#%@$&="
MARKS = FIRST_MARKS + "".join(
    c for c in string.ascii_letters + string.digits if c not in FIRST_MARKS
)  # distinct without colours
CLEAR = "\x1b[2J\x1b[H"


def watch(files: Sequence[str], interval: int, once: bool) -> None:
    """Redraw every `interval` seconds until no run is being written; draw only once if `once`.

    Raises InputError if a file is not a run file.
    """
    names = short_names(files)
    while True:
        being_computed = [is_being_written(Path(file)) for file in files]
        runs = {name: read_records(file) for name, file in zip(names, files, strict=True)}
        size = shutil.get_terminal_size((100, 30))
        drawing = draw(runs, size.columns, max(12, size.lines - len(runs) - 1))
        lines = [
            f"{mark_of(k)} {status(name, run, active)}"
            for k, ((name, run), active) in enumerate(zip(runs.items(), being_computed, strict=True))
        ]
        print(("" if once else CLEAR) + "\n".join([drawing.rstrip("\n"), *lines]), flush=True)
        if once or not any(being_computed):
            return
        time.sleep(interval)


def mark_of(number: int) -> str:
    """Return the character that marks the run with this number, counted from 0."""
    return MARKS[number % len(MARKS)]


def read_records(file: str) -> xarray.Dataset:
    """Load the records of a run into memory, and close the file.

    The file is opened only once: if the run were saved between two openings, versions would be mixed. Raises InputError
    if it is not a run file.
    """
    with open_netcdf(file, "run", verify=False) as dataset:
        run = xarray.open_dataset(NetCDF4DataStore(dataset, lock=LIBRARY), decode_times=False).set_coords(
            "axial_strain"
        )
        # older run files lack these variables
        unknown = {"stress_sff": np.nan * run["stress"], "void_ratio": np.nan * run["axial_strain"]}
        return run.assign({k: v for k, v in unknown.items() if k not in run})[list(SHOWN)].load()


def status(name: str, run: xarray.Dataset, active: bool) -> str:
    """Summarise a run in one line; `active` is True if a process is writing the file."""
    strain = run.lab.strain()
    state = "complete" if run.attrs["complete"] else "running" if active else "interrupted"
    cyclic = run.lab.path is not None and run.lab.path.cyclic
    cycles = f"{float(run.lab.cycles()[-1]):.2f} cycles, " if cyclic else ""
    return (
        f"{name}: {run.attrs['path']} {state}, {run.sizes['time']} records, "
        f"{cycles}{strain.long_name} {float(strain[-1]):.2%}, "
        f"p {float(run.lab.mean_stress()[-1]) / 1e6:.3f} MPa, error of C0 {float(run.lab.sff_error()[-1]):.2%}"
    )


def draw(runs: Mapping[str, xarray.Dataset], width: int, height: int) -> str:
    """Draw three diagrams as text, `width` columns by `height` lines; each run has its own mark (`mark_of`).

    Raises InputError if plotext is not installed.
    """
    plotext = require_library("plotext", "diagrams in the terminal", "watch")
    plotext.main()  # selects the whole figure, so that the next line clears every panel
    plotext.clear_figure()
    plotext.theme("clear")
    plotext.subplots(1, 3)
    plotext.plot_size(width, height)
    names = {run.lab.strain_measure.short for run in runs.values()}
    strain = f"{names.pop() if len(names) == 1 else 'strain'} (%)"
    panels = (
        ("q (MPa)", strain, lambda r: (r.lab.strain() * 100, r.lab.q() / 1e6)),
        ("void ratio e", "p (MPa)", lambda r: (r.lab.mean_stress() / 1e6, r["void_ratio"])),
        ("C0 error (%)", strain, lambda r: (r.lab.strain() * 100, r.lab.sff_error() * 100)),
    )
    for number, (title, x_label, values) in enumerate(panels, start=1):
        plotext.subplot(1, number)
        plotext.title(title)
        plotext.xlabel(x_label)
        for k, run in enumerate(runs.values()):
            x, y = (np.asarray(v) for v in values(run))
            known = np.isfinite(x) & np.isfinite(y)
            if known.any():
                plotext.plot(x[known].tolist(), y[known].tolist(), marker=mark_of(k))
    return plotext.build()
