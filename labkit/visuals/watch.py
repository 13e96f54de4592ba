"""A live view of runs in the terminal, where batches run: q-eps, e-p and the error of C0, drawn again and again.

A run file is replaced as a whole at every save, so that it can be read while the run goes on.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import plotext
import xarray

from labkit.io.interruption import being_written
from labkit.runs.dataset import open_run

SHOWN = ("stress", "stress_sff", "void_ratio", "axial_strain")
MARKS = "*o+x#%@$&="  # one for each run: terminals may have no colours


def watch(files: Sequence[str], interval: int, once: bool) -> None:
    """Draws until no run goes on any more, every `interval` seconds, or `once`. Raises InputError."""
    while True:
        runs = {Path(file).name.removesuffix(".run.nc"): records(file) for file in files}
        going_on = [being_written(Path(file)) for file in files]
        size = shutil.get_terminal_size((100, 30))
        if not once:
            print("\x1b[2J\x1b[H", end="")  # clears the terminal
        print(draw(runs, size.columns, max(12, size.lines - len(runs) - 2)))
        lines = (status(name, run, writes) for (name, run), writes in zip(runs.items(), going_on, strict=True))
        print(*lines, sep="\n", flush=True)
        if once or not any(going_on):
            return
        time.sleep(interval)


def records(file: str) -> xarray.Dataset:
    """What is shown of a run, in memory, the file closed."""
    with open_run(file) as run:
        return run[list(SHOWN)].load()


def status(name: str, run: xarray.Dataset, going_on: bool) -> str:
    """One line on a run; `going_on`: whether a process writes it now."""
    strain = float(run["axial_strain"][-1])
    state = "complete" if run.attrs["complete"] else "going on" if going_on else "interrupted"
    return (
        f"{name}: {run.attrs['path']} {state}, {run.sizes['time']} records, axial strain {strain:.2%}, "
        f"p {float(run.lab.mean_stress()[-1]) / 1e6:.3f} MPa, C0 off by {float(run.lab.sff_error()[-1]):.2%}"
    )


def draw(runs: Mapping[str, xarray.Dataset], width: int, height: int) -> str:
    """The three diagrams as text, of that many columns and lines."""
    plotext.main()  # what is cleared below is the whole figure, not the panel that was drawn last
    plotext.clear_figure()
    plotext.theme("clear")
    plotext.subplots(1, 3)
    plotext.plot_size(width, height)
    panels = (
        ("q (MPa), strain (%)", lambda r: (r["axial_strain"] * 100, r.lab.deviatoric_stress() / 1e6)),
        ("e, p (MPa)", lambda r: (r.lab.mean_stress() / 1e6, r["void_ratio"])),
        ("C0 error (%), strain (%)", lambda r: (r["axial_strain"] * 100, r.lab.sff_error() * 100)),
    )
    for number, (title, values) in enumerate(panels, start=1):
        plotext.subplot(1, number)
        plotext.title(title)
        for k, (name, run) in enumerate(runs.items()):
            x, y = values(run)
            label = name if len(runs) > 1 else None
            plotext.plot(x.values.tolist(), y.values.tolist(), label=label, marker=MARKS[k % len(MARKS)])
    return plotext.build()
