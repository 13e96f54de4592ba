"""Files for ParaView: grains, contacts and cell of a specimen or of the snapshots of a run.

The VTK XML files (.vtu) of the snapshots are listed with their times in .pvd files. SI units, single precision;
compression positive. The files are written with meshio, a much smaller package than vtk.
"""

from __future__ import annotations

import itertools
import os
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from labkit.errors import InputError
from labkit.io.atomic import whole_file
from labkit.io.extras import install_command
from labkit.micro.fabric import statistics
from labkit.micro.grains import grain_fabric, grain_stress, mean_per_grain
from labkit.micro.normalised import normalised_normal_force
from labkit.micro.snapshot import Snapshot, contacts_per_grain
from labkit.micro.stress import deviatoric_stress, love_stress, mean_stress
from labkit.micro.void_ratio import void_ratio_nominal

HINT = (
    "in ParaView, show grains with Glyph (Sphere, scaled by diameter, factor 1) and contacts with Tube (radius varied "
    "by tube_radius, absolute)"
)
TUBE = 0.08  # tube radius of a contact that carries the mean force, in mean grain diameters

Mesh = tuple[np.ndarray, tuple[str, np.ndarray], dict, dict]  # points, cells, point data, cell data


def require_meshio() -> types.ModuleType:
    """The meshio module. Raises InputError if it is not installed."""
    try:
        import meshio
    except ImportError:
        raise InputError(f"files for ParaView need meshio: {install_command('paraview')}") from None
    return meshio


def write_series(snapshots: Iterable[Snapshot], folder: str | os.PathLike) -> list[Path]:
    """Writes Snapshots into an existing folder; returns the .pvd files to open."""
    meshio = require_meshio()
    folder = Path(folder)
    times: dict[str, dict[str, float]] = {name: {} for name in MESHES}
    for snapshot in snapshots:
        for name, mesh_of in MESHES.items():
            file = folder / f"{name}_{snapshot.number:04d}.vtu"
            points, cells, point_data, cell_data = mesh_of(snapshot)
            mesh = meshio.Mesh(
                np.float32(points),
                [cells],
                {key: _small(values) for key, values in point_data.items()},
                {key: [_small(values)] for key, values in cell_data.items()},
            )
            with whole_file(file) as temporary:
                meshio.write(temporary, mesh, file_format="vtu")
            times[name][file.name] = snapshot.time
    return [write_collection(folder / f"{name}.pvd", files) for name, files in times.items()]


def write_collection(path: Path, times: Mapping[str, float]) -> Path:
    """Writes a .pvd file, ParaView's list of files over time, and returns its path. `times`: file name -> s."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for file, time in times.items():
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(time)), part="0", file=file)
    with whole_file(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    return path


def _small(values: object) -> np.ndarray:
    """Converts values to single precision and tensors to rows of nine, as VTK stores them."""
    values = np.asarray(values)
    if values.ndim > 1:
        values = values.reshape(len(values), int(np.prod(values.shape[1:])))
    kinds = {"b": np.uint8, "i": np.int32, "f": np.float32}
    return values.astype(kinds[values.dtype.kind])


def grains(snapshot: Snapshot) -> Mesh:
    """Points at the grain centres. Tensors per grain: fabric <n n> and stress, see labkit.micro.grains."""
    grain, normalised = np.arange(snapshot.number_of_grains), normalised_normal_force(snapshot)
    of_grains = mean_per_grain(snapshot, normalised)
    force = np.stack([snapshot.contacts.normal_force] * 2, axis=1)
    stress = grain_stress(snapshot)
    data = {
        "diameter": 2.0 * snapshot.radius,
        "grain": grain,
        "coordination_number": contacts_per_grain(snapshot),
        "mean_normalised_force": of_grains,
        "normalised_force_over_mean": over_mean(of_grains, normalised),
        "mean_normal_force": mean_per_grain(snapshot, force),
        "fabric": grain_fabric(snapshot),
        "stress": stress,
        "mean_stress": mean_stress(stress),
        "deviatoric_stress": deviatoric_stress(stress),
    }
    if snapshot.velocity is not None:
        data["velocity"] = snapshot.velocity
    return snapshot.wrapped_position, ("vertex", grain[:, None]), data, {}


def contact_mesh(snapshot: Snapshot) -> Mesh:
    """Lines between the centres of grains in contact; a contact across a face of the cell ends outside the cell."""
    contacts, both = snapshot.contacts, normalised_normal_force(snapshot).mean(axis=1)
    ratio = over_mean(both, both)
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
        "friction_mobilised": np.divide(tangential, limit, out=np.zeros_like(limit), where=limit > 0.0),
        "first_grain": contacts.grain[:, 0],
        "second_grain": contacts.grain[:, 1],
        "periodic": _crosses_face(snapshot),
    }
    ends = {
        "normalised_force_over_mean": np.repeat(ratio, 2),  # on points too: ParaView's Tube needs point data
        "tube_radius": np.repeat(TUBE * 2.0 * snapshot.radius.mean() * ratio, 2),
    }
    lines = np.arange(2 * len(contacts)).reshape(-1, 2)
    return snapshot.contact_ends().reshape(-1, 3), ("line", lines), ends, data


def cell(snapshot: Snapshot) -> Mesh:
    """The cell as one hexahedron, with the stress and the five statistics of C0."""
    stress = love_stress(snapshot)
    values = {
        "stress": stress,
        "mean_stress": mean_stress(stress),
        "deviatoric_stress": deviatoric_stress(stress),
        "void_ratio_nominal": void_ratio_nominal(snapshot),
        **vars(statistics(snapshot)),
    }
    if snapshot.axial_strain is not None:
        values["axial_strain"] = snapshot.axial_strain
    return cell_corners(snapshot.cell), ("hexahedron", np.arange(8)[None]), {}, {k: [v] for k, v in values.items()}


def cell_corners(cell: np.ndarray) -> np.ndarray:
    """Corners (8, 3), m, of a cell (3, 3) at the origin, in the order of VTK: around the bottom, then the top."""
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return np.array([(*xy, z) for z, xy in itertools.product((0, 1), around)]) @ cell.T


def over_mean(values: np.ndarray, of: np.ndarray) -> np.ndarray:
    """Values divided by the mean of `of`; zero if `of` is empty or its mean is not positive."""
    mean = of.mean() if len(of) else 0.0
    return values / mean if mean > 0.0 else np.zeros_like(values)


def _crosses_face(snapshot: Snapshot) -> np.ndarray:
    """True for each contact across a face of the cell, shape (contact,)."""
    gap = snapshot.contact_ends()[:, 1] - snapshot.wrapped_position[snapshot.contacts.grain[:, 1]]
    return np.linalg.norm(gap, axis=1) > 0.5 * snapshot.radius.min()


MESHES = {"grains": grains, "contacts": contact_mesh, "cell": cell}
