"""Calibrations that leave one path out, of the paper's model, of its readings and of an amendment."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path

from analysis.model_evidence.inversion import observe_inverted
from analysis.paper.ends import Runs
from analysis.paper.model_comparison import CALIBRATED_ON
from labkit.engines import Progress
from labkit.model import Model, Parameters, fit, observe

TABLE_2, CALIBRATED, AMENDED = "Table 2", "calibrated", "amended"
PATHS = ("cv", "cr", "cp", "isoc", "isod", "cyclic_cp")
FROM_Z_AND_A = "from Z and A alone"  # Lambda and F are inverted from the stress, with F^t as part of F (section 5.4)
START_OF_AMENDMENT = 10.0  # c_dLam from which the fit starts
VARIANTS: dict[str, Callable[[Model], Model]] = {  # name -> the paper's model with one choice changed
    CALIBRATED: lambda model: model,
    AMENDED: lambda model: Model(model.parameters, model.readings, model.young_modulus, START_OF_AMENDMENT),
    "C4 by distance": lambda model: model.reading(force_rate="distance"),
    "reported void ratio": lambda model: model.reading(line_void_ratio="reported"),
    FROM_Z_AND_A: lambda model: model.with_parameters(Ft_c=1e-6),
}
NO_MOBILISATION = ("Ft_c", "c_M")  # parameters that Z and A alone do not determine
Calibrations = Mapping[tuple[str, str], Model]  # (variant, path left out) -> model


def training(runs: Runs, left_out: str) -> Runs:
    """The tests to which a model that is judged on the path `left_out` is fitted: one seed, all other paths."""
    return {
        name: run for name, run in runs.items() if re.fullmatch(CALIBRATED_ON, name) and run.attrs["path"] != left_out
    }


def calibrate_all(runs: Runs, file: Path, progress: Progress) -> Calibrations:
    """The fits of all VARIANTS with each of PATHS left out; those stored in `file` are not fitted again.

    `runs`: from analysis.paper.ends.in_memory; `progress`: called with (fraction, text).
    """
    stored: dict[str, dict[str, str]] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for k, variant in enumerate(VARIANTS):
        for j, path in enumerate(PATHS):
            if path not in stored.setdefault(variant, {}):
                progress((k + j / len(PATHS)) / len(VARIANTS), f"fitting the model `{variant}` without {path} tests")
                stored[variant][path] = json.loads(_fit(training(runs, path), variant).to_json())
                file.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return read_calibrations(file)


def _fit(tests: Runs, variant: str) -> Model:
    start = VARIANTS[variant](Model())
    if variant != FROM_Z_AND_A:
        return fit([observe(name, run) for name, run in tests.items()], start).model
    names = [field.name for field in dataclasses.fields(Parameters) if field.name not in NO_MOBILISATION]
    return fit([observe_inverted(name, run) for name, run in tests.items()], start, names).model


def read_calibrations(file: Path) -> Calibrations:
    """The stored fits."""
    stored = json.loads(file.read_text(encoding="utf-8"))
    return {
        (variant, path): Model.from_json(json.dumps(values))
        for variant, fits in stored.items()
        for path, values in fits.items()
    }
