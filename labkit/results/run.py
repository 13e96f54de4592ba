"""Run: the results of a test."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING, overload

from labkit.errors import InputError, require_file_name
from labkit.files.writable import stem
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.micro.snapshot import Snapshot
from labkit.paths.ending import Endings, endings_of
from labkit.paths.path import Path
from labkit.plugins import module_of_plugin
from labkit.records.limits import Exceeded, exceeded_limits
from labkit.results.endings import how_it_ended, path_and_origin
from labkit.results.figures import FIGURES, figure_for
from labkit.text.html import html_table

if TYPE_CHECKING:
    import pyvista
    import xarray
    from matplotlib.figure import Figure


class Snapshots(Sequence[Snapshot]):
    """Snapshots of a run as a sequence; each snapshot is read when it is accessed."""

    def __init__(self, data: xarray.Dataset) -> None:
        """Store a Dataset opened with labkit.open_run."""
        self._data = data

    def __len__(self) -> int:
        return int(self._data.sizes["snapshot"])

    @overload
    def __getitem__(self, number: int) -> Snapshot: ...

    @overload
    def __getitem__(self, number: slice) -> list[Snapshot]: ...

    def __getitem__(self, number: int | slice) -> Snapshot | list[Snapshot]:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        if not -len(self) <= number < len(self):
            raise IndexError(f"snapshot {number} does not exist: this run has {len(self)} snapshots")
        return self._data.lab.snapshot(number)


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """The results of a test.

    `data` is the xarray.Dataset that labkit.open_run returns, with the accessor `.lab`; `file` is the run file, or None
    for a run in memory; `last` is the last State of a run in memory.
    """

    data: xarray.Dataset
    file: File | None = None
    last: State | None = None

    @classmethod
    def open(cls, file: str | os.PathLike[str]) -> Run:
        """Return the Run of a run file; values are read when accessed. Raises InputError for any other file."""
        from labkit.results.dataset import open_run  # imports xarray, which `labkit run` does not need

        require_file_name(file, "labkit.Run.open('r.run.nc')")
        return cls(open_run(file), File(file))

    @property
    def complete(self) -> bool:
        """True if the loading path was completed."""
        return bool(self.data.attrs["complete"])

    @property
    def state(self) -> State:
        """The State at the end of the run, or at the last save of an unfinished run; a new run can continue from it.

        Raises InputError if the run has no State, as predictions of the model.
        """
        if self.last is not None:
            return self.last
        if self.file is None:
            raise InputError("this run in memory has no state: open its file with labkit.Run.open")
        return read_state(self.file)

    @property
    def ended_because(self) -> str:
        """The reason why the test ended before its path, or could not be completed; empty if it reached the end."""
        return str(self.data.attrs.get("ended_because", ""))

    @property
    def endings(self) -> Endings:
        """Why the steps of the path that ended at conditions, and the run, ended; empty in files of 0.2.0.dev0."""
        return endings_of(self.data.attrs)

    @property
    def met_conditions(self) -> tuple[str, ...]:
        """The conditions that ended steps or the run, e.g. `it ended when q/p > 0.5`, and those that were never met."""
        return how_it_ended(self.data.attrs, self.data["coordination_number"].values)

    @property
    def exceeded(self) -> tuple[Exceeded, ...]:
        """Limits of quasi-static tests that the run exceeded, each an Exceeded with name, limit and largest value.

        Limits exist for the inertial number (3e-4), the mean overlap (2 % of D), the mean stress (0.02 E) and the
        relative error of each held stress (2 %).
        """
        return exceeded_limits(self.data.lab.records_with_limits(), self.scene, self.path)

    @property
    def snapshots(self) -> Snapshots:
        """Snapshots of the run; `run.snapshots[-1]` is the last one."""
        return Snapshots(self.data)

    @property
    def scene(self) -> Scene:
        """Scene of the run: material, grading and contact law."""
        return self.data.lab.scene

    @property
    def path(self) -> Path | None:
        """Loading path; None if the path is not registered in this process (see labkit.use)."""
        return self.data.lab.path

    @property
    def engine(self) -> str:
        """Name of the engine that computed the run."""
        return str(self.data.attrs["engine"])

    @property
    def precision(self) -> str:
        """Precision in which the engine computed the run: double or mixed."""
        return str(self.data.attrs.get("precision", "double"))

    @property
    def threads(self) -> int | None:
        """Number of threads of the last command that extended the run; None if the file does not record it."""
        return int(self.data.attrs["threads"]) if "threads" in self.data.attrs else None

    @property
    def wall_time(self) -> float:
        """Wall time of the simulation, s."""
        return float(self.data.attrs["wall_time"])

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return int(self.data.attrs["steps"])

    @property
    def provenance(self) -> dict[str, object]:
        """Provenance: command, versions, computer and inputs (labkit.files.provenance); empty if the file has none."""
        return json.loads(self.data.attrs.get("provenance") or "{}")

    def plot(
        self, figure: str | None = None, data: Mapping[str, Run] | Sequence[Run] | Run = (), **options: object
    ) -> Figure:
        """Draw a figure of labkit.results.figures.FIGURES.

        The default is the figure that suits the path. Raises InputError for an unknown figure, or for `data` in a
        figure of one run.

        Args:
            figure: Name of the figure.
            data: Other runs and measured tests (labkit.read_measured) to draw as well; a mapping names them in the
                legend, where this run is "run" unless it is among them.
            options: Options of the figure.
        """
        draw = FIGURES.require(figure or figure_for(self.path), "figure")
        if not data:
            return draw(self.data, **options)[0]
        if not draw.several:
            several = ", ".join(name for name in FIGURES if FIGURES[name].several)
            raise InputError("draws no data", field="figure", value=draw.name, allowed=f"one of {several}")
        named = dict(data) if isinstance(data, Mapping) else _by_name([data] if isinstance(data, Run) else data)
        if self not in named.values():
            named["run"] = self
        return draw({name: run.data for name, run in named.items()}, **options)[0]

    def to_pyvista(self, snapshot: int = -1) -> pyvista.MultiBlock:
        """Return the blocks `grains`, `contacts` and `cell` of a snapshot, with values, as meshes of PyVista.

        `run.to_pyvista()["grains"].glyph(geom=pyvista.Sphere(), scale="diameter", factor=1.0).plot()` draws the grains.
        SI units. Raises InputError if the run has no such snapshot, or if PyVista is not installed.
        """
        meshes = module_of_plugin("Run.to_pyvista", "labkit.plugins.exchange.paraview")
        return meshes.as_pyvista(self.snapshots[snapshot])

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        data, measure = self.data, self.data.lab.strain_measure
        strain = measure.at(data["strain"].values)
        ratio, pressure = data.lab.stress_ratio().values, data.lab.mean_stress().values / 1e3
        rows = {
            "path": path_and_origin(data.attrs),
            "complete": ", ".join(("yes" if self.complete else "no", *self.met_conditions)),
            "limits exceeded": ", ".join(limit.name for limit in self.exceeded) or "none",
            measure.name: f"{strain[0]:.3g} to {strain[-1]:.4g}",
            "mean stress": f"{pressure[0]:.4g} to {pressure[-1]:.4g} kPa",
            "q/p": f"{ratio[0]:.3g} to {ratio[-1]:.3g}, largest {abs(ratio[data.lab.peak()]):.3g}",
            "void ratio": f"{float(data['void_ratio'][0]):.4f} to {float(data['void_ratio'][-1]):.4f}",
            "records": f"{data.sizes['time']}, {len(self.snapshots)} with snapshots",
            "grains": f"{data.lab.number_of_grains}",
            "file": "in memory" if self.file is None else str(self.file),
        }
        return html_table("Run", rows | ({"ended because": self.ended_because} if self.ended_because else {}))

    def __repr__(self) -> str:
        state = ", ".join(("complete" if self.complete else "not complete", *self.met_conditions))
        where = "in memory" if self.file is None else str(self.file)
        return (
            f"Run({path_and_origin(self.data.attrs)}, {state}, {self.data.sizes['time']} records, "
            f"{len(self.snapshots)} snapshots of {self.data.lab.contents}, {where})"
        )


def _by_name(runs: Iterable[Run]) -> dict[str, Run]:
    """Return runs by name of the measured test, file or path; a number is added where a name is taken."""
    named: dict[str, Run] = {}
    for run in runs:
        file = stem(run.file) if run.file else ""
        name = str(run.data.attrs.get("test") or file or run.data.attrs["path"])
        named[f"{name} {len(named) + 1}" if name in named else name] = run
    return named
