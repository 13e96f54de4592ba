"""Checks of a measured test after it was read: units, signs, pressures, and tests that were joined by mistake."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.micro.tensors import to_six
from labkit.paths.path import Held
from labkit.plugins.laboratory_data.measured import Measured, held_by, in_percent, kilopascal, words
from labkit.plugins.laboratory_data.starts import sign_of_volume, start_of_strain, start_of_stress
from labkit.plugins.laboratory_data.table import LaboratoryColumns
from labkit.plugins.laboratory_data.units import STRAIN_UNITS, STRESS_UNITS, unit_factor
from labkit.text.foreign import Doubt
from labkit.text.reading import is_numeral

CLOSE = 0.05  # largest relative deviation of a first stress from that of the path
HOLDS = 0.15  # largest relative deviation of a held stress in nine of ten rows
LARGEST_STRAIN = 0.7
SMALL_STRAIN = 4e-3
LARGEST_RATIO = {1.0: 2.5, -1.0: 1.45}  # of |q|/p, by the sign of q: 62 degrees in compression, 73 in extension
LARGEST_STRESS = 200e6  # Pa
LEAST_STRESS = 1e3  # Pa
VOID_RATIOS = (0.1, 3.0)
SAME_VOID_RATIO = 0.02
SAME_STRESS = 0.02  # relative deviation of a third stress from the other two
SAME_VOLUME = 2e-3  # largest volumetric strain of a test at constant volume
SECOND = 0.03  # a second test begins this close to the start of the first, relative to its largest strain
NOISE = 2e-3  # smaller steps back, relative to the largest strain, are not mentioned


def unit_findings(columns: Mapping[str, Sequence[str | None]], units: Mapping[str, str]) -> list[Doubt]:
    """Compare the units that the user gave with those that the file states."""
    doubts = []
    for quantity, (header, unit, *sign) in columns.items():
        stated = units.get(str(header))
        if unit is None or stated is None:
            continue
        of_stress = unit_factor(unit, STRESS_UNITS) is not None
        factors = STRESS_UNITS if of_stress else STRAIN_UNITS
        factor = unit_factor(stated, factors)
        if factor != unit_factor(unit, factors) and not (of_stress and stated == "1"):
            right = f"{quantity}={':'.join(map(str, (header, stated.strip('[]() '), *sign)))}"
            kind = "stresses" if of_stress else "void ratios" if quantity == "void_ratio" else "strains"
            right = f"a column of {kind}" if factor is None else right
            text = f"{quantity} has the unit {unit}, but the file says {stated} for {header!r}"
            doubts.append(Doubt(f"{text}: give {right}", True))
    return doubts


def findings_of(test: Measured) -> list[Doubt]:
    """Return what all checks of a measured test find."""
    before = (start_of_strain, start_of_stress, sign_of_volume, _restarts, _direction, _sizes, _tension)
    checks = (*before, _held, _ratio, _third_stress, _volume, _void_ratio)
    return [finding for check in checks for finding in check(test)]


def _restarts(test: Measured) -> list[Doubt]:
    """Find a second test below the first: the axial strain returns to its start from one row to the next."""
    strain = test.records["axial_strain"]
    if test.path.cyclic:
        return [Doubt(f"{text}: give --rows if these are several tests") for text in _names(test.table)]
    along = np.abs(strain - strain[0])
    reached = np.maximum.accumulate(along)
    back = np.flatnonzero((along[1:] <= SECOND * reached[:-1]) & (reached[:-1] > NOISE * reached[-1])) + 1
    back = back[(along[back - 1] > 0.5 * reached[back - 1])]
    if len(back):
        row = int(back[0])
        advice = "--rows HEADER=VALUE, or --header with the line of its headers"
        for header, texts in test.table.texts.items():
            if texts[row] != texts[row - 1] and len(set(texts)) < max(len(texts) // 2, 3):
                advice = f"--rows {header}={texts[0]} or {header}={texts[row]}"
                break
        text = f"the axial strain falls from {in_percent(strain[row - 1])} to {in_percent(strain[row])}"
        return [Doubt(f"{text} in line {test.line(row)}: is this a second test? Give {advice}", True)]
    steps = reached - along
    if steps.max() <= NOISE * reached[-1]:
        return []
    rows = np.flatnonzero(steps > NOISE * reached[-1])
    text = f"the axial strain goes back by up to {in_percent(steps.max())} from line {test.line(rows[0])}: unloading"
    return [Doubt(f"{text}; comparisons use the rows in which it advances")]


def _names(table: LaboratoryColumns) -> list[str]:
    """Return the other columns that may name several tests: a few texts, each in rows that follow each other."""
    names = []
    for header, texts in table.texts.items():
        changes = sum(before != other for before, other in itertools.pairwise(texts))
        if 0 < changes < len(set(texts)) <= len(texts) / 2 and not any(map(is_numeral, texts)):
            names.append(f"the column {header} has {', '.join(dict.fromkeys(texts))}"[:200])
    return names


def _direction(test: Measured) -> list[Doubt]:
    """Find strains whose sign differs from that of the path."""
    strain, target = test.records["axial_strain"], float(getattr(test.path, "strain", 0.0))
    largest = strain[np.argmax(np.abs(strain))]
    if test.path.cyclic or not largest * target < 0.0:
        return []
    text = f"the axial strain goes to {in_percent(largest)}, and the path {test.path.name} to {in_percent(target)}"
    return [Doubt(f"{text}: give the other positive sign, compression or tension, or a --strain of this sign", True)]


def _sizes(test: Measured) -> list[Doubt]:
    """Find strains and stresses that are too large or too small for their unit."""
    doubts = []
    for name in ("axial_strain", "volumetric_strain"):
        if name in test.values and (largest := np.abs(test.values[name]).max()) > LARGEST_STRAIN:
            doubts.append(Doubt(f"the {words(name)} reaches {in_percent(largest)}: is its unit right (1 or %)?", True))
    largest = np.abs(test.records["axial_strain"]).max()
    if test.path.shear and largest < SMALL_STRAIN and not test.path.cyclic:
        doubts.append(Doubt(f"the axial strain reaches only {in_percent(largest)}: is its unit right (1 or %)?"))
    stress = np.nan_to_num(test.records["stress"]).diagonal(axis1=1, axis2=2)
    largest = np.abs(stress).max()
    if largest > LARGEST_STRESS or 0.0 < largest < LEAST_STRESS:
        doubts.append(Doubt(f"the stresses reach {kilopascal(largest)}: is their unit right?", True))
    return doubts


def _tension(test: Measured) -> list[Doubt]:
    """Find effective stresses that are not compressive."""
    stress = test.records["stress"].diagonal(axis1=1, axis2=2)[:, [2, 0]]  # axial, radial
    scale = np.nanmax(np.abs(stress[0])) or np.nanmax(np.abs(stress))
    least, row = np.nanmin(stress), int(np.nanargmin(np.nanmin(stress, axis=1)))
    if least > 0.0:
        return []
    name = ("axial", "radial")[int(np.nanargmin(stress[row]))]
    number = int((np.nanmin(stress, axis=1) <= 0.0).sum())
    text = f"the effective {name} stress is {kilopascal(least)} in line {test.line(row)}, not above 0 in {number} rows"
    if least > -0.02 * scale:
        return [Doubt(text)]
    return [Doubt(f"{text}: check its sign, its unit{_sizes_of_units(test)}, and --stress-kind", True)]


def _sizes_of_units(test: Measured) -> str:
    """Return a hint if one stress is a hundred times as large as another."""
    sizes = {k: np.abs(v).max() for k, v in test.values.items() if k.endswith("_stress") and np.abs(v).max() > 0.0}
    if len(sizes) < 2 or max(sizes.values()) < 100.0 * min(sizes.values()):
        return ""
    large, small = max(sizes, key=lambda k: sizes[k]), min(sizes, key=lambda k: sizes[k])
    return f" ({words(large)} is {sizes[large] / sizes[small]:.0f} times {words(small)})"


def _held(test: Measured) -> list[Doubt]:
    """Find stresses that differ from those that the path starts from and holds."""
    start = test.path.start_pressure()
    stress = test.records["stress"]
    if start is None:
        return []
    conditions = [
        condition for condition in test.path.held() if condition.kind == "stress" and not callable(condition.target)
    ]
    if not conditions:
        p = float(mean_stress(stress[0]))
        return [] if abs(p / start - 1.0) <= CLOSE else [_other_pressure("mean stress", p, start, test)]
    return [finding for condition in conditions for finding in _holds(condition, stress, test)]


def _holds(condition: Held, stress: np.ndarray, test: Measured) -> list[Doubt]:
    """Compare a stress that the path holds with the measured one."""
    target = np.atleast_1d(np.asarray(condition.target, dtype=float))
    measured = to_six(stress) @ np.atleast_2d(condition.measure).T
    first, wanted = measured[0], target
    if not (wanted > 0.0).all():
        return []
    if (np.abs(first / wanted - 1.0) > CLOSE).any():
        return [_other_pressure(condition.name, float(first[0]), float(wanted[0]), test)]
    off = np.abs(measured / wanted - 1.0).max(axis=1)
    if np.quantile(off, 0.9) <= HOLDS:
        return []
    row = int(np.argmax(off))
    text = f"the path {test.path.name} holds the {condition.name}, but it changes to {kilopascal(measured[row, 0])}"
    return [Doubt(f"{text} in line {test.line(row)}: give the path of this test, e.g. cv if it is undrained", True)]


def _other_pressure(name: str, measured: float, stated: float, test: Measured) -> Doubt:
    """Return the finding for a first stress that differs from the one stated, with what to give instead."""
    text = f"the {name} is {kilopascal(measured)} in line {test.line(0)}, and --pressure says {kilopascal(stated)}"
    if measured == 0.0:
        return Doubt(f"{text}: give the column of the stresses that were measured", True)
    factor = measured / stated
    if factor > 500.0 or 0.0 < factor < 2e-3:
        factors = f"about {factor:.3g} times too large" if factor > 1.0 else f"about {1.0 / factor:.3g} times too small"
        return Doubt(f"{text}: is the unit of the stresses right? They are {factors}", True)
    total = "; or, if the stresses are total, --stress-kind total and a column pore_pressure"
    total *= measured > stated and "pore_pressure" not in test.columns
    return Doubt(f"{text}: give --pressure {measured / 1e3:.4g}kPa{total}", True)


def _ratio(test: Measured) -> list[Doubt]:
    """Find stress ratios that no soil reaches."""
    stress = test.records["stress"]
    if np.isnan(stress[:, 0, 0]).all():
        return []
    p, q = mean_stress(stress), deviatoric_stress(stress)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(p > 0.05 * abs(p[0]), q / p, 0.0)
    row = int(np.argmax(np.abs(ratio) / np.where(ratio > 0.0, LARGEST_RATIO[1.0], LARGEST_RATIO[-1.0])))
    if abs(ratio[row]) <= LARGEST_RATIO[1.0 if ratio[row] > 0.0 else -1.0]:
        return []
    text = f"q/p is {ratio[row]:.3g} in line {test.line(row)}, more than any soil reaches"
    return [Doubt(f"{text}: check the units of the stresses{_sizes_of_units(test)}, and --stress-kind", True)]


def _third_stress(test: Measured) -> list[Doubt]:
    """Find a third column of stresses that contradicts the two from which the stresses are computed."""
    stress, pore = test.records["stress"], test.pore_pressure
    computed = {
        "axial_stress": stress[:, 2, 2] + pore,
        "radial_stress": stress[:, 0, 0] + pore,
        "deviatoric_stress": deviatoric_stress(stress),
        "mean_stress": mean_stress(stress) + pore,
    }
    doubts = []
    for name, value in computed.items():
        if name in test.values and not np.isnan(value).any():
            off = np.abs(test.values[name] - value)
            row = int(np.argmax(off))
            if off[row] > SAME_STRESS * np.abs(value).max():
                text = f"the {words(name)} is {kilopascal(test.values[name][row])} in line {test.line(row)}"
                text += f", but {kilopascal(value[row])} follows from the other stresses"
                doubts.append(Doubt(f"{text}: leave out the column that is wrong", True))
    return doubts


def _volume(test: Measured) -> list[Doubt]:
    """Find volumetric strains of a test at constant volume, and pore pressures of a test that is drained."""
    undrained = any(condition.kind == "volume" for condition in held_by(test.path))
    if undrained and "volumetric_strain" in test.values:
        largest = np.abs(test.values["volumetric_strain"]).max()
        if largest > SAME_VOLUME:
            text = (
                f"the path {test.path.name} keeps the volume, but the volumetric strain reaches {in_percent(largest)}"
            )
            return [Doubt(f"{text}: give the path of a drained test, e.g. cr", True)]
    if not undrained and "pore_pressure" in test.values and not test.path.cyclic:
        u, p = test.values["pore_pressure"], abs(float(np.nan_to_num(mean_stress(test.records["stress"][0]))))
        if p and np.ptp(u) > 0.2 * p:
            change = kilopascal(float(np.ptp(u)))
            text = f"the pore pressure changes by {change}, but the path {test.path.name} is drained"
            return [Doubt(f"{text}: give cv if the test was undrained", True)]
    return []


def _void_ratio(test: Measured) -> list[Doubt]:
    """Find void ratios out of range, and void ratios that contradict the volumetric strain."""
    e, doubts = test.records["void_ratio"], []
    row = int(np.argmax(np.abs(e - 1.0)))
    if not (e > VOID_RATIOS[0]).all() or not (e < VOID_RATIOS[1]).all():
        text = f"the void ratio is {e[row]:.4g} in line {test.line(row)}, not between 0.1 and 3"
        advice = "check the column void_ratio and its unit" if test.void_ratio is None else "check --void-ratio"
        if 3.0 < e[0] <= 300.0 and "void_ratio" not in test.values:
            advice = f"give --void-ratio {e[0] / 100.0:g} if it is in percent"
        doubts.append(Doubt(f"{text}: {advice}; also check the unit of the volumetric strain", True))
    elif "void_ratio" in test.values:
        follows = (1.0 + e[0]) * test.records["volume"] / test.records["volume"][0] - 1.0
        row = int(np.argmax(np.abs(follows - e)))
        other = (1.0 + e[0]) * test.records["volume"][0] / test.records["volume"] - 1.0
        reverse = np.abs(other - e).max() < 0.25 * abs(follows[row] - e[row])
        if abs(follows[row] - e[row]) > (SAME_VOID_RATIO / 10.0 if reverse else SAME_VOID_RATIO):
            text = f"the void ratio is {e[row]:.4g} in line {test.line(row)}, but {follows[row]:.4g} follows from the"
            doubts.append(Doubt(f"{text} volumetric strain: check its sign, or leave out one of the two", True))
        if test.void_ratio is not None and abs(test.void_ratio - e[0]) > 0.005:
            text = f"--void-ratio {test.void_ratio:g} is not used: the column void_ratio begins with {e[0]:.4g}"
            doubts.append(Doubt(text))
    return doubts
