"""Grains, contacts and cell as meshes: a file for ParaView of a specimen or a run, and objects of PyVista.

The file is VTKHDF 2.3, with one block each for grains, contacts and cell over time, in SI units and single precision.
Compression is positive.
"""

from __future__ import annotations

import os
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from labkit.files.atomic import reserve
from labkit.files.library import new_hdf5
from labkit.micro.bodies import long_axes
from labkit.micro.cells import cell_corners
from labkit.micro.contact_sides import normalised_normal_force
from labkit.micro.fabric import statistics
from labkit.micro.grains import grain_fabric, grain_stress, mean_per_grain, over_mean
from labkit.micro.snapshot import Snapshot, contacts_per_grain, love_stress
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.process.extras import require_library

if TYPE_CHECKING:
    import h5py
    import pyvista

HINT = (
    "in ParaView 5.13 or later, show grains with Glyph (Sphere, scaled by diameter, factor 1) and contacts with Tube "
    "(radius varied by tube_radius, absolute)"
)
TUBE = 0.08  # tube radius of a contact that carries the mean force, in mean grain diameters
VERSION = (2, 3)  # version of VTKHDF
CHUNK = (64, 4096)  # least and largest number of rows in a chunk
MARGIN = 1_000_000  # approximate size of a file without its values, bytes
VERTEX, LINE, HEXAHEDRON = 1, 3, 12  # cell types of VTK


class Mesh(NamedTuple):
    """Points (n, 3), m; cells (k, corners) of one VTK type; and values on points and cells by name."""

    points: np.ndarray
    cells: np.ndarray
    kind: int
    point_data: Mapping[str, object]
    cell_data: Mapping[str, object]

    @property
    def nbytes(self) -> int:
        """Size in double precision, bytes, which is an upper bound for the size in the file."""
        values = (*self.point_data.values(), *self.cell_data.values())
        return self.points.nbytes + 3 * self.cells.nbytes + sum(np.asarray(each).nbytes for each in values)


def require_h5py() -> types.ModuleType:
    """Import and return h5py, which writes the file. Raises InputError if it is not installed."""
    return require_library("h5py", "files for ParaView", "paraview")


def write_series(snapshots: Iterable[Snapshot], file: str | os.PathLike[str]) -> Path:
    """Write Snapshots to a .vtkhdf file, one after another; returns the path of the file."""
    with new_hdf5(file, MARGIN, require_h5py()) as data:
        root = data.create_group("VTKHDF", track_order=True)  # VTK reads blocks in this order
        _describe(root, "PartitionedDataSetCollection")
        assembly = root.create_group("Assembly", track_order=True)
        for index, name in enumerate(MESHES):
            _describe(root.create_group(name), "UnstructuredGrid")
            root[name].attrs["Index"] = index
            assembly[name] = require_h5py().SoftLink(f"/VTKHDF/{name}")
        size = MARGIN
        for snapshot in snapshots:
            meshes = {name: mesh_of(snapshot) for name, mesh_of in MESHES.items()}
            size += sum(mesh.nbytes for mesh in meshes.values())
            reserve(Path(data.filename), size)
            for name, mesh in meshes.items():
                _add_step(root[name], snapshot.time, mesh)
    return Path(file)


def _describe(group: h5py.Group, kind: str) -> None:
    group.attrs["Version"] = VERSION
    group.attrs["Type"] = np.bytes_(kind)


def _add_step(block: h5py.Group, time: float, mesh: Mesh) -> None:
    """Append the mesh at a time, s; the group Steps records where its rows begin in the datasets of the block."""
    offsets = np.arange(len(mesh.cells) + 1) * mesh.cells.shape[1]
    step = {
        "Values": np.array([time]),
        "NumberOfParts": np.array([1]),
        "PartOffsets": np.array([_length(block, "NumberOfPoints")]),
        "PointOffsets": np.array([_length(block, "Points")]),
        "CellOffsets": np.array([[_length(block, "Types")]]),
        "ConnectivityIdOffsets": np.array([[_length(block, "Connectivity")]]),
    }
    numbers: dict[str, np.ndarray] = {
        "NumberOfPoints": np.array([len(mesh.points)]),
        "NumberOfCells": np.array([len(mesh.cells)]),
        "NumberOfConnectivityIds": np.array([mesh.cells.size]),
        "Points": np.asarray(mesh.points, np.float32),
        "Connectivity": mesh.cells.ravel(),
        "Offsets": offsets,
        "Types": np.full(len(mesh.cells), mesh.kind, np.uint8),
    }
    for group, values in (("PointData", mesh.point_data), ("CellData", mesh.cell_data)):
        for name in values:
            step[f"{group}Offsets/{name}"] = np.array([_length(block, f"{group}/{name}")])
            numbers[f"{group}/{name}"] = _small(values[name])
    for name, rows in numbers.items():
        _append(block, name, rows)
    for name, rows in step.items():
        _append(block, f"Steps/{name}", rows)
    block["Steps"].attrs["NSteps"] = len(block["Steps/Values"])


def _length(block: h5py.Group, name: str) -> int:
    """Return the number of rows of a dataset; 0 if the dataset does not exist yet."""
    return len(block[name]) if name in block else 0


def _append(block: h5py.Group, name: str, rows: np.ndarray) -> None:
    """Append rows to a dataset; create it if necessary."""
    if name not in block:
        length = min(max(len(rows), CHUNK[0]), CHUNK[1])
        block.create_dataset(name, data=rows, maxshape=(None, *rows.shape[1:]), chunks=(length, *rows.shape[1:]))
        return
    block[name].resize(len(block[name]) + len(rows), axis=0)
    block[name][len(block[name]) - len(rows) :] = rows


def _small(values: object) -> np.ndarray:
    """Convert values to single precision and tensors to rows of nine, as VTK stores them."""
    values = np.asarray(values)
    if values.ndim > 1:
        values = values.reshape(len(values), int(np.prod(values.shape[1:])))
    kinds = {"b": np.uint8, "i": np.int32, "f": np.float32}
    return values.astype(kinds[values.dtype.kind])


def grains(snapshot: Snapshot) -> Mesh:
    """Return points at the centres of grains, or of spheres of clumps, with fabric <n n> and stress of each grain."""
    grain, normalised = np.arange(snapshot.number_of_grains), normalised_normal_force(snapshot)
    of_grains = mean_per_grain(snapshot, normalised)
    force = np.stack([snapshot.contacts.normal_force] * 2, axis=1)
    stress = grain_stress(snapshot)
    data = {
        "diameter": 2.0 * snapshot.radius,
        "grain": grain,
        "coordination_number": contacts_per_grain(snapshot),
        "mean_normalised_force": of_grains,
        "normalised_force_over_mean": over_mean(of_grains, np.abs(normalised)),
        "mean_normal_force": mean_per_grain(snapshot, force),
        "fabric": grain_fabric(snapshot),
        "stress": stress,
        "mean_stress": mean_stress(stress),
        "deviatoric_stress": deviatoric_stress(stress),
    }
    spheres, axes = snapshot.spheres, long_axes(snapshot)
    data |= {} if axes is None else {"long_axis": axes}
    data = {name: snapshot.of_spheres(values) for name, values in data.items()}
    data["diameter"] = 2.0 * spheres.radius
    if spheres.velocity is not None:
        data["velocity"] = spheres.velocity
    return Mesh(spheres.wrapped_position, np.arange(len(spheres.radius))[:, None], VERTEX, data, {})


def contact_mesh(snapshot: Snapshot) -> Mesh:
    """Return lines between the centres of grains in contact; a line across a face of the cell ends outside the cell.

    `friction_mobilised` is left out if the law has cohesion, which changes the friction limit.
    """
    both, snapshot = normalised_normal_force(snapshot).mean(axis=1), snapshot.spheres
    contacts = snapshot.contacts
    ratio = over_mean(both, np.abs(both))
    tangential = np.linalg.norm(contacts.tangential_force, axis=1)
    limit = snapshot.scene.friction * contacts.normal_force
    data = {
        "normal_force": contacts.normal_force,
        "tangential_force": contacts.tangential_force,
        "force_on_first": contacts.force_on_first(),
        "rolling_moment": contacts.rolling_moment,
        "overlap": contacts.overlap,
        "normalised_force": both,
        "normalised_force_over_mean": ratio,
        "strong": ratio > 1.0,
        "first_grain": contacts.grain[:, 0],
        "second_grain": contacts.grain[:, 1],
        "periodic": _crosses_face(snapshot),
    }
    if not contacts.columns:
        data["friction_mobilised"] = np.divide(tangential, limit, out=np.zeros_like(limit), where=limit > 0.0)
    ends = {
        "normalised_force_over_mean": np.repeat(ratio, 2),  # also on points: ParaView's filter Tube needs point data
        "tube_radius": np.repeat(TUBE * 2.0 * snapshot.radius.mean() * np.abs(ratio), 2),
    }
    lines = np.arange(2 * len(contacts)).reshape(-1, 2)
    return Mesh(snapshot.contact_ends().reshape(-1, 3), lines, LINE, ends, data)


def cell(snapshot: Snapshot) -> Mesh:
    """Return the cell as one hexahedron, with the stress and the five statistics of C0."""
    stress = love_stress(snapshot)
    values = {
        "stress": stress,
        "mean_stress": mean_stress(stress),
        "deviatoric_stress": deviatoric_stress(stress),
        "void_ratio_nominal": void_ratio_nominal(snapshot),
        **statistics(snapshot).by_name(),
    }
    if snapshot.axial_strain is not None:
        values["axial_strain"] = snapshot.axial_strain
    of_cell = {name: [value] for name, value in values.items()}
    return Mesh(cell_corners(snapshot.cell), np.arange(8)[None], HEXAHEDRON, {}, of_cell)


def _crosses_face(snapshot: Snapshot) -> np.ndarray:
    """Return True for each contact across a face of the cell, (contact,)."""
    gap = snapshot.contact_ends()[:, 1] - snapshot.wrapped_position[snapshot.contacts.grain[:, 1]]
    return np.linalg.norm(gap, axis=1) > 0.5 * snapshot.radius.min()


MESHES = {"grains": grains, "contacts": contact_mesh, "cell": cell}


def as_pyvista(snapshot: Snapshot) -> pyvista.MultiBlock:
    """Return the grains, contacts and cell of a Snapshot for PyVista. Raises InputError if PyVista is not installed."""
    library = require_library("pyvista", "meshes for PyVista", "pyvista")
    blocks = library.MultiBlock()
    for name, mesh_of in MESHES.items():
        mesh = mesh_of(snapshot)
        corners = np.insert(mesh.cells, 0, mesh.cells.shape[1], axis=1)
        block = library.UnstructuredGrid(corners.ravel(), np.full(len(corners), mesh.kind, np.uint8), mesh.points)
        for values, into in ((mesh.point_data, block.point_data), (mesh.cell_data, block.cell_data)):
            for key, value in values.items():
                into[key] = _small(value)
        blocks.append(block, name)
    return blocks
