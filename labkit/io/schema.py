"""Schema of state and run files: name, dimensions, type, units and long name of every variable."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of a file: dimensions and type in netCDF terms, units and long name as CF requires."""

    name: str
    dimensions: tuple[str, ...]
    dtype: str
    units: str
    long_name: str


def _table(*rows: tuple[str, str, str, str, str]) -> dict[str, Variable]:
    return {row[0]: Variable(row[0], tuple(row[1].split()), *row[2:]) for row in rows}


STATE = _table(
    ("radius", "grain", "f8", "m", "grain radius"),
    ("position", "grain i", "f8", "m", "position of the grain centre, not wrapped into the cell"),
    ("velocity", "grain i", "f8", "m s-1", "grain velocity including the mean field, half a time step earlier"),
    ("angular_velocity", "grain i", "f8", "rad s-1", "angular velocity of the grain, half a time step earlier"),
    ("cell", "i j", "f8", "m", "periodic cell, cell vectors as columns"),
    ("velocity_gradient", "i j", "f8", "s-1", "velocity gradient of the cell"),
    ("contact_grain", "contact side", "i4", "1", "first and second grain of the contact"),
    ("contact_shift", "contact i", "i4", "1", "periodic shift of the second grain, in cell vectors"),
    ("tangential_force", "contact i", "f8", "N", "tangential contact force on the first grain"),
    ("rolling_moment", "contact i", "f8", "N m", "rolling resistance moment on the first grain"),
)

RECORD = _table(
    ("time", "time", "f8", "s", "time since the start of the path"),
    ("axial_strain", "time", "f8", "1", "logarithmic strain in z, compression positive"),
    ("strain", "time i j", "f8", "1", "logarithmic strain, compression positive"),
    ("cell", "time i j", "f8", "m", "periodic cell, cell vectors as columns"),
    ("volume", "time", "f8", "m3", "volume of the cell"),
    ("stress", "time i j", "f8", "Pa", "Love's stress, compression positive"),
    ("stress_sff", "time i j", "f8", "Pa", "stress predicted by stress-force-fabric equation C0, compression positive"),
    ("void_ratio", "time", "f8", "1", "void ratio, overlaps subtracted from the solid volume"),
    ("void_ratio_nominal", "time", "f8", "1", "void ratio of the undeformed grain volumes"),
    ("coordination_number", "time", "f8", "1", "coordination number Z"),
    ("contact_anisotropy", "time i j", "f8", "1", "anisotropy of the contact normals A"),
    ("mean_normalised_force", "time", "f8", "1", "mean normalised normal contact force Lambda"),
    ("normal_force_anisotropy", "time i j", "f8", "1", "anisotropy of the normalised normal force F"),
    ("mobilisation", "time i j", "f8", "1", "mobilisation F^t: mean normal (x) tangential force / mean normal force"),
    ("inertial_number", "time", "f8", "1", "inertial number"),
    ("overlap_ratio", "time", "f8", "1", "mean of overlap over grain diameter"),
    ("rattler_fraction", "time", "f8", "1", "share of grains with fewer than two contacts"),
    ("kinetic_energy", "time", "f8", "J", "kinetic energy relative to the mean field"),
    ("unbalanced_force", "time", "f8", "1", "mean resultant force on a grain over mean contact force"),
    ("elastic_energy", "time", "f8", "J", "elastic energy of the contact springs"),
    ("cell_work", "time", "f8", "J", "work of the cell on the grains since the start of the path"),
    ("friction_loss", "time", "f8", "J", "energy dissipated by sliding"),
    ("rolling_loss", "time", "f8", "J", "energy dissipated by rolling at the moment limit"),
    ("damping_loss", "time", "f8", "J", "energy dissipated by local damping or dashpots"),
    ("energy_balance_error", "time", "f8", "1", "energy unaccounted for, over work of the cell or initial energy"),
    ("drift_velocity", "time i", "f8", "m s-1", "velocity of the centre of mass relative to the mean field"),
)

# A run file must contain these. Other variables missing in files of earlier versions or other programs read as NaN.
ESSENTIAL = ("axial_strain", "strain", "cell", "volume", "stress")

CONTACTS = _table(
    ("record", "snapshot", "i4", "1", "index of the snapshot along time"),
    ("row_size", "snapshot", "i4", "1", "number of contacts in the snapshot"),
    ("contact_grain", "contact side", "i4", "1", "first and second grain of the contact"),
    ("normal", "contact i", "f8", "1", "unit normal from the first to the second grain"),
    ("overlap", "contact", "f8", "m", "penetration depth"),
    ("normal_force", "contact", "f8", "N", "normal contact force, compression positive"),
    ("tangential_force", "contact i", "f8", "N", "tangential contact force on the first grain"),
    ("rolling_moment", "contact i", "f8", "N m", "rolling resistance moment on the first grain"),
)

GRAINS = _table(
    ("radius", "grain", "f8", "m", "grain radius"),
    ("position", "snapshot grain i", "f8", "m", "position of the grain centre, not wrapped into the cell"),
)

SIZES = {"i": 3, "j": 3, "side": 2}
