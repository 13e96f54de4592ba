"""Checks of the beginning of a measured test: strains, stresses and pore pressures that count from elsewhere."""

from __future__ import annotations

import numpy as np

from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.plugins.laboratory_data.measured import Measured, held_by, in_percent, kilopascal, words
from labkit.text.foreign import Doubt

OFFSET = 5e-4  # smaller strains in the first row are not mentioned
SEATING = 0.05  # smaller ratios q/p in the first row are not mentioned
ISOTROPIC = 0.1  # ratio q/p up to which shearing has not begun
SAME = 0.05  # relative difference of equal stresses
REVERSED = 3e-4  # volumetric strain of an initial dilation
BEFORE = 0.6  # soil contracts at stress ratios below this fraction of the largest one, unless p falls


def start_of_strain(test: Measured) -> list[Doubt]:
    """Find strains of a shear test that do not begin at zero."""
    columns = (name for name in ("axial_strain", "volumetric_strain") if name in test.values)
    off = {name: float(test.values[name][0]) for name in columns if abs(test.values[name][0]) > OFFSET}
    if test.path.cyclic or not test.path.shear or not off:
        return []
    text = " and ".join(f"the {words(name)} is {in_percent(value)}" for name, value in off.items())
    text += f" in line {test.line(0)}, the first row"
    if abs(ratio := _first_ratio(test)) <= ISOTROPIC:
        return [Doubt(f"{text}, where shearing begins: give --zero {' '.join(off)} to count from there", True)]
    return [
        Doubt(f"{text}, where q/p is {ratio:.2g}: is the beginning missing, or should they count from there, --zero?")
    ]


def start_of_stress(test: Measured) -> list[Doubt]:
    """Find a shear test that begins with a deviatoric stress, or with a pore pressure that its stresses do not have."""
    pore = float(np.ravel(test.pore_pressure)[0])
    stress, ratio = test.records["stress"][0], _first_ratio(test)
    p, q, line = float(mean_stress(stress)), float(deviatoric_stress(stress)), test.line(0)
    if np.ndim(test.pore_pressure) and p <= 0.0 < pore:
        text = (
            f"the pore pressure is {kilopascal(pore)} in line {line}, and the total mean stress {kilopascal(p + pore)}"
        )
        return [Doubt(f"{text}: give --zero pore_pressure if only the pore pressure has a back pressure", True)]
    doubts = []
    if np.ndim(test.pore_pressure) and abs(pore) <= SEATING * p and np.ptp(test.pore_pressure) > SEATING * p:
        text = f"the pore pressure begins with {kilopascal(pore)}, the effective mean stress with {kilopascal(p)}"
        doubts.append(Doubt(f"{text}: is a back pressure in the total stresses, but not in the pore pressure?"))
    late = abs(float(test.records["axial_strain"][0])) > OFFSET
    if test.path.cyclic or not test.path.shear or late or not abs(ratio) > SEATING:
        return doubts
    text = f"the deviatoric stress is {kilopascal(q)} in line {line}, before any strain"
    others = [test.values[name][0] for name in ("radial_stress", "mean_stress") if name in test.values]
    if "deviatoric_stress" in test.values:
        first = float(test.values["deviatoric_stress"][0])
        if any(abs(first - other) <= SAME * abs(other) for other in others):
            text = f"the deviatoric stress is {kilopascal(first)} in line {line}, as large as the other stress"
            return [*doubts, Doubt(f"{text}: is it an axial stress? Give its column as axial_stress", True)]
        advice = "give --zero deviatoric_stress if it is a seating load"
    else:
        advice = "give a column deviatoric_stress and --zero deviatoric_stress if it is a seating load"
    isotropic = test.path.start_pressure() is not None
    return [*doubts, Doubt(f"{text}: {advice}; labkit's test starts isotropic" if isotropic else text, isotropic)]


def _first_ratio(test: Measured) -> float:
    """Return q/p in the first row; 0 if it is unknown."""
    p, q = (float(measure(test.records["stress"][0])) for measure in (mean_stress, deviatoric_stress))
    return q / p if p > 0.0 and np.isfinite(q) else 0.0


def sign_of_volume(test: Measured) -> list[Doubt]:
    """Find a compression test that dilates first, as no soil does while p does not fall, or one whose e is constant."""
    target, undrained = (
        getattr(test.path, "strain", 0.0),
        any(condition.kind == "volume" for condition in held_by(test.path)),
    )
    if test.path.cyclic or not test.path.shear or not target > 0.0 or undrained:
        return []
    strain, p = -np.log(test.records["volume"] / test.records["volume"][0]), mean_stress(test.records["stress"])
    if "volumetric_strain" not in test.values:
        if strain.any():
            return []
        e = test.records["void_ratio"][0]
        text = f"the void ratio is {e:.4g} in every row, and the path {test.path.name} is drained"
        return [Doubt(f"{text}: give it as --void-ratio, and a column volumetric_strain", True)]
    ratio = deviatoric_stress(test.records["stress"]) / np.where(p > 0.0, p, np.inf)
    row = max(int(np.argmax(ratio >= BEFORE * ratio.max())) - 1, 0)
    if not strain[row] < -REVERSED:  # with few rows, by the dilation before the contraction
        row = int(np.argmin(strain))
        if strain[row] > -REVERSED or strain[row:].max() - strain[row] < 0.5 * abs(strain[row]):
            return []
    if p[: row + 1].min() < (1.0 - SAME) * p[0]:
        return []
    reached = f"by {in_percent(-strain[row])} up to line {test.line(row)}, where q/p is {ratio[row]:.2g}"
    text = f"the volume first grows, {reached}"
    return [Doubt(f"{text}: give the other positive sign of the volumetric strain, compression or tension", True)]
