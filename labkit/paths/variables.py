"""Work-conjugate variables in which a step prescribes stresses and strains: Cartesian, Roscoe's and Rendulic's.

Six tensors T_i define a set of variables: the stress variables are T_i : sigma, and the strain variables e_i give the
strain as sum_i e_i T_i, so that the sum of stress times strain increments is the work sigma : d(eps). Compression is
positive. With z as the axis of symmetry, Roscoe's variables are

    p = (sigma_xx + sigma_yy + sigma_zz)/3    q = sigma_zz - (sigma_xx + sigma_yy)/2         d = sigma_xx - sigma_yy
    v = eps_xx + eps_yy + eps_zz              q = 2/3 (eps_zz - (eps_xx + eps_yy)/2)         d = (eps_xx - eps_yy)/2

and the isomorphic sets use unit tensors instead, so that the variables preserve the lengths and angles of the tensors.
The shear variables are the stress sigma_xz and the strain gamma_xz = 2 eps_xz, and so on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from labkit.errors import InputError, instead_of
from labkit.parameters import Parameter, warn_of_doubt
from labkit.paths.mixed_step import MixedStep, components_of

SHEAR = ("xz", "yz", "xy")
_X, _Y, _Z = (np.diag(row) for row in np.eye(3))
_DEVIATOR = np.diag([-0.5, -0.5, 1.0])  # _DEVIATOR : sigma = q


def _shear(i: int, j: int) -> np.ndarray:
    """Return the tensor T with T : sigma = sigma_ij; gamma_ij T is then the strain tensor of the shear gamma_ij."""
    tensor = np.zeros((3, 3))
    tensor[i, j] = tensor[j, i] = 0.5
    return tensor


@dataclasses.dataclass(frozen=True, eq=False)
class Variables:
    """A set of variables.

    Args:
        stress: Names of the stress variables.
        strain: Names of the strain variables.
        tensors: The six tensors T_i, (6, 3, 3).
    """

    name: str
    stress: tuple[str, ...]
    strain: tuple[str, ...]
    tensors: np.ndarray


def _set(name: str, stress: str, strain: str, normal: list[np.ndarray]) -> Variables:
    tensors = np.array([*normal, _shear(0, 2), _shear(1, 2), _shear(0, 1)])
    return Variables(name, (*stress.split(), *SHEAR), (*strain.split(), *SHEAR), tensors)


VARIABLES = {
    variables.name: variables
    for variables in (
        _set("cartesian", "zz xx yy", "zz xx yy", [_Z, _X, _Y]),
        _set("roscoe", "p q d", "v q d", [np.eye(3) / 3.0, _DEVIATOR, _X - _Y]),
        _set(
            "roscoe_isomorph",
            "P Q D",
            "P Q D",
            [np.eye(3) / np.sqrt(3.0), _DEVIATOR * np.sqrt(2.0 / 3.0), (_X - _Y) / np.sqrt(2.0)],
        ),
        _set("rendulic", "a r d", "a r d", [_Z, (_X + _Y) / np.sqrt(2.0), (_X - _Y) / np.sqrt(2.0)]),
    )
}


def mixed_step(variables: Variables, on_stress: tuple[bool, ...], changes: np.ndarray, **further: Any) -> MixedStep:
    """Return a MixedStep in which each of six variables has a prescribed change of stress or of strain.

    Raises InputError for values that MixedStep rejects.

    Args:
        variables: The set of variables.
        on_stress: For each variable, True if its stress is prescribed, False if its strain is.
        changes: Changes of stress, Pa, or strain, (n, 6) for n rows.
        further: Other fields of the MixedStep.
    """
    chosen = np.array(on_stress, dtype=bool)
    changes = np.atleast_2d(np.asarray(changes, dtype=float))
    control = components_of(variables.tensors[chosen])
    strain = np.einsum("na,aij->nij", changes[:, ~chosen], variables.tensors[~chosen])
    return MixedStep(
        strain=tuple(strain.ravel()),
        free=control,
        measured=control,
        stress=tuple(changes[:, chosen].ravel()),
        **further,
    )


Changes = Mapping[str, float | str | Sequence[float | str]]


def _in_si(changes: Changes | None, unit: str) -> dict[str, list[float]]:
    """Convert changes, which may be text with a unit, to a number in SI units for each row. Raises InputError."""
    converted = {}
    for name, change in (changes or {}).items():
        definition = Parameter(name, unit=unit, is_strain=unit == "1")
        values = [change] if isinstance(change, str) or not isinstance(change, Iterable) else change
        converted[name] = [definition.read(value) if isinstance(value, str) else value for value in values]
        for value in values:
            warn_of_doubt(definition.doubt(value), depth=3)
    return converted


def increments(
    stress: Changes | None = None,
    strain: Changes | None = None,
    variables: str = "cartesian",
    absolute: bool = False,
    over: float | None = None,
    until: str | None = None,
    records: int | None = None,
    label: str = "",
) -> MixedStep:
    """Return a MixedStep from changes of named stresses, Pa, and strains; all other variables keep their strains.

    Values are numbers or text with a unit, such as "40 kPa" and "1 %", or lists with a value for each row.

        increments(stress={"xx": 0.0, "yy": 0.0}, strain={"zz": 0.05})                          # drained triaxial
        increments(stress={"p": 0.0}, strain={"q": 0.05}, variables="roscoe", until="q/p > 0.9")

    Raises InputError for a name that `variables` does not have, for a variable whose
    stress and strain are both given, and for lists of different lengths.

    Args:
        stress: Changes of stress, Pa, name -> value, or a value for each row.
        strain: Changes of strain, name -> value, or a value for each row.
        variables: Set of variables, such as "cartesian" or "roscoe".
        absolute: True if stresses are values to reach instead of changes.
        over: Accumulated strain of the step.
        until: Condition that ends the step.
        records: Number of records.
        label: Name of the step in messages.
    """
    if variables not in VARIABLES:
        raise InputError("is unknown", field="variables", value=variables, allowed=instead_of(VARIABLES, variables))
    row, stress, strain = VARIABLES[variables], _in_si(stress, "Pa"), _in_si(strain, "1")
    for field, chosen, names in (("stress", stress, row.stress), ("strain", strain, row.strain)):
        for name in chosen:
            if name not in names:
                allowed = f"{instead_of(names, name)}, the {field} variables of {variables}"
                raise InputError("is unknown", field=field, value=name, allowed=allowed, quoted=True)
    lengths = {len(values) for values in (*stress.values(), *strain.values())} - {1}
    if len(lengths) > 1:
        raise InputError("and strain have lists of different lengths", field="stress", allowed="a value for each row")
    changes = []
    for s, e in zip(row.stress, row.strain, strict=True):
        if s in stress and e in strain:
            raise InputError(f"{s} and strain {e} are both given: give one of them", field="stress")
        changes.append(np.asarray(stress.get(s, strain.get(e, [0.0])), dtype=float))
    on_stress = tuple(name in stress for name in row.stress)
    return mixed_step(
        row,
        on_stress,
        np.stack(np.broadcast_arrays(*changes), axis=-1),
        absolute=absolute,
        over=over,
        until=until,
        records=records,
        label=label,
    )
