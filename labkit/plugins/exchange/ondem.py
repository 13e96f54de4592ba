"""ON-DEM files (COST action 22132, working group 3): VTKHDF with the groups ONDEM/Scene, Bodies and Interactions.

The grains are the points of /VTKHDF, with radius and body_id in PointData. In the schema, a normal force is positive in
traction, but the schema's own exporter for YADE writes compression as positive. The schema does not specify the body on
which a shear force acts. labkit writes both conventions as attributes (`positive`, `acts_on`), and asks for them if a
file from another program lacks them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from labkit.files.library import OWN, new_hdf5
from labkit.grains.state import State
from labkit.parameters import Values
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import FIRST, RADIUS, TENSION, Answers, Packing
from labkit.process.extras import require_library

if TYPE_CHECKING:
    import h5py

WHAT = "ON-DEM files"
LENGTHS = {"meter": 1.0, "metre": 1.0, "m": 1.0, "centimeter": 1e-2, "millimeter": 1e-3, "micrometer": 1e-6}
MASSES = {"kilogram": 1.0, "kg": 1.0, "gram": 1e-3, "tonne": 1e3}
TIMES = {"second": 1.0, "s": 1.0, "millisecond": 1e-3, "microsecond": 1e-6}


class OnDem(Format):
    """An ON-DEM file. The periodic box, `periodic_box` in the schema, is `shape` in ONDEM/ImposedConditions."""

    name = "ondem"
    description = "ON-DEM file (VTKHDF)"
    endings = (".vtkhdf",)
    keeps_clumps = keeps_contacts = True

    def recognises(self, file: Path, head: str) -> bool:
        return file.suffix == ".vtkhdf" or (file.suffix in (".h5", ".hdf", ".hdf5") and "HDF" in head[:8])

    def read(self, file: Path, answers: Answers) -> Packing:
        h5py = require_library("h5py", WHAT, "formats")
        try:
            with OWN, h5py.File(file) as data:
                return _packing(data)
        except (KeyError, OSError, RuntimeError, ValueError, TypeError, OverflowError, IndexError):
            raise damaged_file(file, "it lacks a part of the ON-DEM schema") from None

    def write(self, state: State, file: Path) -> None:
        """Write grains, periodic box, material and contacts in SI units, with normal forces positive in traction."""
        with new_hdf5(file, 100_000 + 4 * state.nbytes, require_library("h5py", WHAT, "formats")) as data:
            _write_points(data, state)
            scene = data.create_group("ONDEM/Scene")
            scene.attrs["time"], scene.attrs["timestep"] = state.time, state.time_step
            scene["gravity"] = np.zeros(3)
            scene["units"] = np.array(["second", "meter", "kilogram"], dtype="S8")
            material = data.create_group("ONDEM/Materials/0")
            material["id"], material["density"] = 0, state.scene.density
            material["young"], material["friction_coefficient"] = state.scene.young_modulus, state.scene.friction
            box = data.create_group("ONDEM/ImposedConditions/periodic_box")
            box["shape"], box["velocity_gradient"] = state.cell, state.velocity_gradient
            _write_contacts(data.create_group("ONDEM/Interactions"), state)


def _packing(data: h5py.Group) -> Packing:
    points = data["VTKHDF/PointData"]
    grains: Values = {"position": np.array(data["VTKHDF/Points"], dtype=float)}
    for field, name, kind in (("size", "radius", float), ("id", "body_id", np.int64), ("body", "clump_id", np.int64)):
        if name in points:
            grains[field] = np.array(points[name], dtype=kind)
    notes = []
    if "size" in grains and not (real := grains["size"] > 0.0).all():  # the points include bodies of other shapes
        notes.append(f"{int((~real).sum())} bodies that are not spheres are left out")
        grains = {name: values[real] for name, values in grains.items()}
    metre, newton = _units(data)
    path = data.visit(lambda path: path if path.split("/")[-1] == "periodic_box" else None)
    cell = None if path is None else np.array(data[path]["shape"], dtype=float)
    return Packing(
        **grains,
        size_is=RADIUS if "size" in grains else None,
        cell=cell,
        origin=None if cell is None else np.zeros(3),
        contacts=_contacts(data["ONDEM/Interactions"]) if "ONDEM/Interactions" in data else None,
        length_unit=metre,
        force_unit=newton,
    ).with_notes(*notes)


def _units(data: h5py.Group) -> tuple[float | None, float | None]:
    """Return (length in m, force in N) from the units of time, length and mass in ONDEM/Scene."""
    scene = data["ONDEM/Scene"] if "ONDEM/Scene" in data else {}
    units = scene["units"][:] if "units" in scene else getattr(scene, "attrs", {}).get("units", ())
    names = [(name.decode() if isinstance(name, bytes) else str(name)).lower() for name in units]
    if len(names) != 3:
        return None, None
    second, metre, kilogram = TIMES.get(names[0]), LENGTHS.get(names[1]), MASSES.get(names[2])
    if second is None or metre is None or kilogram is None:
        return metre, None
    return metre, kilogram * metre / second**2


def _contacts(interactions: h5py.Group) -> ContactList | None:
    """Read the contacts in ONDEM/Interactions, combining its subgroups if each contact law has its own."""
    groups = [interactions] if "id1" in interactions else []
    interactions.visititems(lambda _, each: groups.extend([each] * (hasattr(each, "keys") and "id1" in each)))
    if not groups:
        return None
    first = groups[0]
    joined = {
        name: np.concatenate([group[name][()] for group in groups])
        for name in ("id1", "id2", "normal_force", "shear_force", "overlap", "virtual")
        if all(name in group for group in groups)
    }
    if "virtual" in joined:
        real = joined["virtual"] == 0
        joined = {name: values[real] for name, values in joined.items()}
    return ContactList(
        grain=np.stack([joined["id1"], joined["id2"]], axis=1).astype(np.int64),
        normal_force=joined.get("normal_force"),
        positive=_attribute(first, "normal_force", "positive"),
        tangential_force=joined.get("shear_force"),
        acts_on=_attribute(first, "shear_force", "acts_on"),
        overlap=joined.get("overlap"),
    )


def _attribute(group: h5py.Group, name: str, attribute: str) -> str | None:
    return str(group[name].attrs[attribute]) if name in group and attribute in group[name].attrs else None


def _write_points(data: h5py.Group, state: State) -> None:
    grains, scene = state.number_of_grains, state.scene
    vtk = data.create_group("VTKHDF")
    vtk.attrs.create("Type", np.bytes_("PolyData"))
    vtk.attrs.create("Version", np.array([2, 0], dtype=np.int64))
    vtk["Points"], vtk["NumberOfPoints"] = state.position, np.array([grains], dtype=np.int64)
    for name in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = grains if name == "Vertices" else 0
        vtk[f"{name}/NumberOfCells"] = vtk[f"{name}/NumberOfConnectivityIds"] = np.array([cells], dtype=np.int64)
        vtk[f"{name}/Offsets"] = np.arange(cells + 1, dtype=np.int64)
        vtk[f"{name}/Connectivity"] = np.arange(cells, dtype=np.int64)
    inertia = scene.moment_of_inertia(state.radius)
    values = {
        "body_id": np.arange(grains, dtype=np.int32),
        "material_id": np.zeros(grains, dtype=np.int32),
        "clump_id": np.full(grains, -1, dtype=np.int32) if state.bodies is None else state.bodies.body.astype(np.int32),
        "position": state.position,
        "velocity": state.velocity,
        "angular_velocity": state.angular_velocity,
        "orientation": np.tile([0.0, 0.0, 0.0, 1.0], (grains, 1)),
        "mass": scene.mass(state.radius),
        "inertia": inertia[:, None] * np.eye(3).ravel(),
        "volume": 4.0 / 3.0 * np.pi * state.radius**3,
        "radius": state.radius,
    }
    for name, array in values.items():
        vtk[f"PointData/{name}"] = array


def _write_contacts(group: h5py.Group, state: State) -> None:
    contacts = state.snapshot().spheres.contacts
    group.attrs["count"] = len(contacts)
    group["id1"], group["id2"] = contacts.grain[:, 0].astype(np.int32), contacts.grain[:, 1].astype(np.int32)
    group["normal"], group["overlap"] = contacts.normal, contacts.overlap
    group["normal_force"], group["shear_force"] = -contacts.normal_force, contacts.tangential_force
    group["virtual"] = np.zeros(len(contacts), dtype=np.int8)
    group["normal_force"].attrs["positive"] = TENSION
    group["shear_force"].attrs["acts_on"] = FIRST
