"""Probes: the results of a set of probes, with its stiffness, table and file.

The fitted stiffness, the stiffness in a direction and the second-order work refer to the Kirchhoff stress, the stress
per initial volume J sigma with J = V/V_0. It is conjugate to the logarithmic strain, so an elastic stiffness is
symmetric. The stiffness for Cauchy's stress differs by sigma (x) I, which is not symmetric unless the stress is
isotropic.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING

import numpy as np
import pandas
import xarray

from labkit.errors import InputError, require_file_name
from labkit.files.netcdf import name_damage, write_xarray
from labkit.files.provenance import provenance_json
from labkit.files.schema import CONVENTIONS, NO_COMMAND
from labkit.micro.tensors import to_six
from labkit.plugins.probes.probing import Plane, Probing, plane_of
from labkit.results.dataset import open_whole
from labkit.results.figures import FIGURES
from labkit.results.tables import with_axes
from labkit.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIX = ("row", "column")

VARIABLES = {  # name: (dimensions after `probe`, units, long name)
    "material": ((), "1", "grains, elastic (grains whose contacts cannot slide) or model"),
    "angle": ((), "degree", "angle of the direction in the plane of the probes"),
    "start_sha256": ((), "1", "hash of the first record of the probe: positions, contacts, forces, stress"),
    "start_stress": (("i", "j"), "Pa", "stress before the probe, compression positive"),
    "strain_increment": (("i", "j"), "1", "increment of the logarithmic strain, without that of the null probe"),
    "stress_increment": (("i", "j"), "Pa", "increment of the stress, without that of the null probe"),
    "null_strain": (("i", "j"), "1", "strain of the probe without an increment"),
    "null_stress": (("i", "j"), "Pa", "change of stress of the probe without an increment"),
    "sliding_loss": ((), "J m-3", "energy dissipated by sliding and rolling, per volume"),
    "damping_loss": ((), "J m-3", "energy dissipated by damping, per volume"),
    "contacts_gained": ((), "1", "contacts at the end that did not exist at the start"),
    "contacts_lost": ((), "1", "contacts at the start that do not exist at the end"),
    "unbalanced_force": ((), "1", "unbalanced force at the end"),
}
TEXTS = ("material", "start_sha256")


def dataset_of(
    plane: Plane,
    probing: Probing,
    material: str,
    angle: np.ndarray,
    rows: Sequence[Mapping[str, object]],
    affine: np.ndarray | None = None,
) -> xarray.Dataset:
    """Return the Dataset of Probes from the variables of each probe and the affine stiffness, Pa; NaN where absent."""
    columns = {"material": [material] * len(rows), "angle": angle}
    for name, (dimensions, _, _) in VARIABLES.items():
        absent = "" if name in TEXTS else np.full((3,) * len(dimensions), np.nan)
        columns.setdefault(name, np.array([row.get(name, absent) for row in rows]))
    data = {
        name: (("probe", *dimensions), np.asarray(columns[name]), {"units": units, "long_name": text})
        for name, (dimensions, units, text) in VARIABLES.items()
    }
    bound = np.full((6, 6), np.nan) if affine is None else affine
    text = "stiffness if all grains moved with the mean field, Mandel notation"
    affine_stiffness = (SIX, bound, {"units": "Pa", "long_name": text})
    attributes = {"kind": probing.kind, "plane": plane.name}
    return with_axes(xarray.Dataset({**data, "affine_stiffness": affine_stiffness}, attrs=attributes))


@dataclasses.dataclass(frozen=True, eq=False)
class Probes:
    """Probes of one state: of the grains, of their elastic response, or of the model.

    `data` is an xarray.Dataset along `probe` with the variables of VARIABLES and the affine stiffness; `file` is its
    file, if any.
    """

    data: xarray.Dataset
    file: File | None = None

    @property
    def kind(self) -> str:
        """What was prescribed: `strain` or `stress`."""
        return str(self.data.attrs["kind"])

    @property
    def plane(self) -> Plane:
        """Plane of the directions."""
        return plane_of(self.data.attrs["plane"])

    @property
    def materials(self) -> tuple[str, ...]:
        """The probed materials, in the order grains, elastic, model."""
        return tuple(dict.fromkeys(self.data["material"].values.tolist()))

    def of(self, material: str) -> Probes:
        """Return the probes of one material. Raises InputError if the set has none."""
        if material not in self.materials:
            raise InputError("was not probed", field="material", value=material, allowed=" or ".join(self.materials))
        return Probes(self.data.isel(probe=self.data["material"].values == material), self.file)

    def __add__(self, other: Probes) -> Probes:
        """Join two sets of probes. Raises InputError unless they have the same plane and kind."""
        if (self.kind, self.plane.name) != (other.kind, other.plane.name):
            raise InputError("probes of different planes or kinds cannot be joined: give the same plane and kind")
        stiffness = [data["affine_stiffness"] for data in (self.data, other.data)]
        affine = stiffness[0] if stiffness[0].notnull().all() else stiffness[1]
        parts = [data.drop_vars("affine_stiffness") for data in (self.data, other.data)]
        joined = xarray.concat(parts, "probe", combine_attrs="override")
        return Probes(joined.assign(affine_stiffness=affine))

    @property
    def strain(self) -> np.ndarray:
        """Increments of strain in Mandel notation, shape (n, 6)."""
        return to_six(self.data["strain_increment"].values)

    @property
    def stress(self) -> np.ndarray:
        """Increments of stress per initial volume, J sigma - sigma_0, in Mandel notation, shape (n, 6), Pa."""
        start, increment = (to_six(self.data[name].values) for name in ("start_stress", "stress_increment"))
        return np.exp(-self.strain[:, :3].sum(axis=1))[:, None] * (start + increment) - start

    def along_axes(self, name: str) -> np.ndarray:
        """Return the components of `strain_increment` or `stress_increment` along the axes of the plane, (n, k)."""
        return to_six(self.data[name].values) @ self.plane.axes.T

    def second_order_work(self) -> np.ndarray:
        """Return the second-order work, stress increment : strain increment, shape (n,), J/m3."""
        return np.einsum("na,na->n", self.stress, self.strain)

    def directional(self) -> np.ndarray:
        """Return the stiffness in each direction d, d : (stress increment)/|strain increment|, shape (n,), Pa.

        For stress probes, return the compliance d : (strain increment)/|stress increment|, 1/Pa.
        """
        prescribed = self.strain if self.kind == "strain" else self.stress
        return self.second_order_work() / np.einsum("na,na->n", prescribed, prescribed)

    def affine_bound(self) -> np.ndarray:
        """Return d : C : d for the direction d of each strain increment and the affine stiffness C, shape (n,), Pa."""
        prescribed, C = self.strain, self.data["affine_stiffness"].values
        return np.einsum("na,ab,nb->n", prescribed, C, prescribed) / np.einsum("na,na->n", prescribed, prescribed)

    def tangent(self) -> np.ndarray:
        """Return the stiffness in the axes of the plane, fitted to strain probes by least squares; (k, k), Pa.

        For stress probes, return the compliance, 1/Pa. In shear the stiffness is 2 G, see `shear_modulus`. If the
        directions are opposite pairs, the fit is a central difference. Raises InputError for several materials.
        """
        prescribed, response = self._project()
        return np.linalg.lstsq(prescribed, response, rcond=None)[0].T

    def shear_modulus(self, component: str = "xz") -> float:
        """Return the shear modulus G = d sigma_xz/(2 d eps_xz) of a component, `xz`, `xy` or `yz`, Pa.

        G is half of the tangent: in shear, the Mandel components of `tangent` and `directional` are 2 G. Raises
        InputError for a plane without this shear, and for directions that do not span the plane.
        """
        if component not in ("xz", "xy", "yz"):
            raise InputError(field="component", value=component, allowed="xz, xy or yz")
        shear = np.zeros((3, 3))
        i, j = ("xyz".index(axis) for axis in component)
        shear[i, j] = shear[j, i] = np.sqrt(0.5)
        along = self.plane.axes @ to_six(shear)
        if not np.isclose(np.linalg.norm(along), 1.0):
            allowed = f"probes of the plane {component}-shear, or all"
            raise InputError(f"has no shear {component}", field="plane", value=self.plane.name, allowed=allowed)
        if not self._spans_plane():
            raise InputError("do not span the plane", field="directions", allowed="4 or more")
        C = self.tangent()
        return float(0.5 * along @ (C if self.kind == "strain" else np.linalg.inv(C)) @ along)

    def asymmetry(self) -> float:
        """Return the asymmetry |C - C^T|/|C| of the tangent C; NaN for directions that do not span the plane."""
        if not self._spans_plane():
            return np.nan
        C = self.tangent()
        return float(np.linalg.norm(C - C.T) / np.linalg.norm(C))

    def misfit(self) -> float:
        """Return the residual of the fit of the tangent, relative to the responses: 0 for a linear material.

        NaN for directions that do not span the plane.
        """
        if not self._spans_plane():
            return np.nan
        prescribed, response = self._project()
        return float(np.linalg.norm(prescribed @ self.tangent().T - response) / np.linalg.norm(response))

    def _spans_plane(self) -> bool:
        """Return True if the prescribed increments span the plane, apart from their noise."""
        prescribed, _ = self._project()
        noise = 0.01 * float(np.linalg.norm(prescribed, 2))
        return bool(np.linalg.matrix_rank(prescribed, tol=noise) == prescribed.shape[1])

    def _project(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the prescribed increments and the responses along the axes of the plane, (n, k) each."""
        if len(self.materials) != 1:
            raise InputError("the probes are of several materials: select one, e.g. probes.of('grains')")
        strain, stress = self.strain @ self.plane.axes.T, self.stress @ self.plane.axes.T
        return (strain, stress) if self.kind == "strain" else (stress, strain)

    def summary(self) -> pandas.DataFrame:
        """Tabulate one row per material.

        The columns are the least and the largest value of `directional`; over_affine, the largest ratio of the
        stiffness to its affine bound; asymmetry and misfit of the tangent; the largest sliding_loss, J/m3;
        contacts_changed, the largest number of contacts gained and lost; and starts, the number of different states
        from which the probes started, which must be 1.
        """
        rows = []
        for probes in map(self.of, self.materials):
            stiffness, data = probes.directional(), probes.data
            rows.append(
                {
                    "material": probes.materials[0],
                    "probes": data.sizes["probe"],
                    "least": stiffness.min(),
                    "largest": stiffness.max(),
                    "over_affine": np.nan if probes.kind == "stress" else (stiffness / self._bound_of(probes)).max(),
                    "asymmetry": probes.asymmetry(),
                    "misfit": probes.misfit(),
                    "sliding_loss": data["sliding_loss"].values.max(),
                    "contacts_changed": (data["contacts_gained"] + data["contacts_lost"]).values.max(),
                    "starts": len(set(data["start_sha256"].values.tolist())),
                }
            )
        return pandas.DataFrame(rows)

    def _bound_of(self, probes: Probes) -> np.ndarray:
        return Probes(probes.data.assign(affine_stiffness=self.data["affine_stiffness"])).affine_bound()

    def table(self) -> pandas.DataFrame:
        """Tabulate one row per probe: increments along the axes (`strain_1`, ...) and by component, dissipation, ..."""
        columns: dict[str, object] = {"material": self.data["material"].values, "angle": self.data["angle"].values}
        for name in ("strain", "stress"):
            along = self.along_axes(f"{name}_increment")
            columns |= {f"{name}_{k + 1}": values for k, values in enumerate(along.T)}
        columns |= {"directional": self.directional(), "second_order_work": self.second_order_work()}
        for name in ("strain", "stress"):
            tensor = self.data[f"{name}_increment"].values
            columns |= {f"{name}_{'xyz'[i]}{'xyz'[j]}": tensor[:, i, j] for i in range(3) for j in range(i, 3)}
        names = [name for name, (dimensions, _, _) in VARIABLES.items() if not dimensions]
        return pandas.DataFrame(columns | {name: self.data[name].values for name in names})

    def plot(self, figure: str = "envelope") -> Figure:
        """Draw a figure of probes. Raises InputError for an unknown figure."""
        return FIGURES.require(figure, "figure")(self.data)[0]

    def write(self, file: str | os.PathLike[str], inputs: Sequence[str] = (), history: str = "") -> None:
        """Write a probes file atomically; `inputs` are the files that were read, `history` the command."""
        attributes = {
            "Conventions": CONVENTIONS,
            "title": f"labkit {self.kind} probes",
            "labkit_file": "probes",
            "labkit_version": __version__,
            "history": history or NO_COMMAND,
            "provenance": provenance_json(history or None, inputs, file),
        }
        encoding: dict[str, object] = {name: {"dtype": "S1"} for name in TEXTS}
        encoding |= {str(name): {"fletcher32": True} for name in self.data.data_vars if name not in TEXTS}
        write_xarray(file, self.data.drop_vars(("i", "j")).assign_attrs(attributes), encoding=encoding)

    def _repr_html_(self) -> str:
        """Return the summary for notebooks."""
        return str(self.summary().to_html(index=False))

    def __repr__(self) -> str:
        number = self.data.sizes["probe"]
        return f"Probes({number} {self.kind} probes, plane {self.plane.name}, {', '.join(self.materials)})"


def read_probes(path: str | os.PathLike[str]) -> Probes:
    """Read a file written by `labkit probe` or Probes.write. Raises InputError if it is not a probes file."""
    require_file_name(path, "labkit.read_probes('p.probes.nc')")
    with name_damage(path), open_whole(path, "probes") as data:
        return Probes(data.load(), File(path))
