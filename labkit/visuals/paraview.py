"""Files for ParaView: grains, contacts and cell of a specimen or of the snapshots of a run.

VTK XML files (.vtu) of each snapshot, and a list of them over time (.pvd). SI units, single precision; stress and
strain with compression positive. meshio writes them: it is hundreds of times smaller than VTK.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from labkit.errors import InputError
from labkit.io.files import whole_file
from labkit.micro.contacts import contacts_per_grain
from labkit.micro.fabric import statistics
from labkit.micro.grains import grain_fabric, grain_stress, mean_per_grain
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.micro.void_ratio import void_ratio_nominal

HINT = (
    "in ParaView: grains with Glyph (Sphere, scaled by diameter, factor 1); contacts with Tube (radius varied by "
    "tube_radius, absolute)"
)
TUBE = 0.08  # radius of a contact of mean force in ParaView, in mean grain diameters


def require_meshio():
    """The module. Raises InputError when it is not installed."""
    try:
        import meshio
    except ImportError:
        raise InputError("files for ParaView need meshio: pip install 'labkit[paraview]'") from None
    return meshio


def write_series(moments, folder):
    """Writes Moments (labkit.visuals.moment) into a folder that is there; the .pvd files to open."""
    meshio = require_meshio()
    folder = Path(folder)
    times = {name: {} for name in MESHES}
    for moment in moments:
        for name, mesh_of in MESHES.items():
            file = folder / f"{name}_{moment.snapshot:04d}.vtu"
            points, cells, point_data, cell_data = mesh_of(moment)
            mesh = meshio.Mesh(
                np.float32(points), [cells], {key: _small(values) for key, values in point_data.items()},
                {key: [_small(values)] for key, values in cell_data.items()},
            )  # fmt: skip
            with whole_file(file) as temporary:
                meshio.write(temporary, mesh, file_format="vtu")
            times[name][file.name] = moment.time
    return [write_collection(folder / f"{name}.pvd", found) for name, found in times.items()]


def write_collection(path, times):
    """Writes a .pvd file, ParaView's list of files over time, and returns its path. `times`: file name -> s."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for file, time in times.items():
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(time)), part="0", file=file)
    with whole_file(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    return path


def _small(values):
    """Single precision, tensors as rows of nine: what the format and its size ask for."""
    values = np.asarray(values)
    if values.ndim > 1:
        values = values.reshape(len(values), int(np.prod(values.shape[1:])))
    kinds = {"b": np.uint8, "i": np.int32, "f": np.float32}
    return values.astype(kinds[values.dtype.kind])


def grains(moment):
    """Points at the centres. Tensors of a grain: fabric <n n> and stress, see labkit.micro.grains."""
    contacts, radius = moment.contacts, moment.radius
    n = len(radius)
    normalised = moment.normalised_force()
    force = np.stack([contacts.normal_force] * 2, axis=1)
    stress = grain_stress(contacts, radius)
    data = {
        "diameter": 2.0 * radius, "grain": np.arange(n), "coordination_number": contacts_per_grain(n, contacts),
        "mean_normalised_force": mean_per_grain(contacts, normalised, n),
        "normalised_force_over_mean": over_mean(mean_per_grain(contacts, normalised, n), normalised),
        "mean_normal_force": mean_per_grain(contacts, force, n), "fabric": grain_fabric(contacts, n),
        "stress": stress, "mean_stress": mean_stress(stress), "deviatoric_stress": deviatoric_stress(stress),
    }  # fmt: skip
    if moment.velocity is not None:
        data["velocity"] = moment.velocity
    return moment.position, ("vertex", np.arange(n)[:, None]), data, {}


def contacts(moment):
    """A line for each contact between the two centres; one through a face of the cell ends beyond it."""
    found, normalised = moment.contacts, moment.normalised_force()
    both = normalised.mean(axis=1)
    ratio = over_mean(both, both)
    tangential = np.linalg.norm(found.tangential_force, axis=1)
    limit = moment.scene.friction * found.normal_force
    data = {
        "normal_force": found.normal_force, "tangential_force": found.tangential_force,
        "force_on_first": found.force_on_first(), "rolling_moment": found.rolling_moment, "overlap": found.overlap,
        "normalised_force": both, "normalised_force_over_mean": ratio, "strong": ratio > 1.0,
        "friction_mobilised": np.divide(tangential, limit, out=np.zeros_like(limit), where=limit > 0.0),
        "first_grain": found.grain[:, 0], "second_grain": found.grain[:, 1],
        "periodic": _crosses_face(moment),
    }  # fmt: skip
    ends = {
        "normalised_force_over_mean": np.repeat(ratio, 2),  # on points too: what ParaView's Tube needs
        "tube_radius": np.repeat(TUBE * 2.0 * moment.radius.mean() * ratio, 2),
    }
    lines = np.arange(2 * len(found)).reshape(-1, 2)
    return moment.contact_ends().reshape(-1, 3), ("line", lines), ends, data


def cell(moment):
    """The cell as one hexahedron, with the stress and the five statistics of C0 on it."""
    fabric = statistics(moment.contacts, moment.radius, moment.scene.young_modulus)
    values = {
        "stress": moment.stress, "mean_stress": mean_stress(moment.stress),
        "deviatoric_stress": deviatoric_stress(moment.stress),
        "void_ratio_nominal": void_ratio_nominal(moment.radius, moment.volume), **vars(fabric),
    }  # fmt: skip
    if moment.axial_strain is not None:
        values["axial_strain"] = moment.axial_strain
    return cell_corners(moment.cell), ("hexahedron", np.arange(8)[None]), {}, {k: [v] for k, v in values.items()}


def cell_corners(cell):
    """The corners (8, 3), m, of a cell (3, 3) at the origin, in VTK's order: around the bottom, then the top."""
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return np.array([(*xy, z) for z, xy in itertools.product((0, 1), around)]) @ cell.T


def over_mean(values, of):
    """Values over the mean of `of`; zero where there are none."""
    mean = of.mean() if len(of) else 0.0
    return values / mean if mean > 0.0 else np.zeros_like(values)


def _crosses_face(moment):
    """Whether the second grain of each contact lies in another period than the first."""
    gap = moment.contact_ends()[:, 1] - moment.position[moment.contacts.grain[:, 1]]
    return np.linalg.norm(gap, axis=1) > 0.5 * moment.radius.min()


MESHES = {"grains": grains, "contacts": contacts, "cell": cell}
