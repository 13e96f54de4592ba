"""A campaign with a known answer: run files of the model with Table 2 along the tests of analysis/paper/paper.yaml.

Its tests reach the critical state, and each has a small random scatter, like specimens of grains.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import analysis.paper
import labkit
from analysis.paper.ends import in_memory
from labkit.model import Model, drive, isotropic_state, model_path
from labkit.model.run_file import write_result
from labkit.paths.path import StressPath
from labkit.plugins.campaigns import read_campaign
from labkit.results import SHEAR
from labkit.sff.c0 import c0_stress
from tests.changed import changed

CAMPAIGN = Path(analysis.paper.__file__).with_name("paper.yaml")
STARTS = {"dense": 0.21e6, "medium": 0.5e6, "loose": 0.3e6, "dense_high": 1e6, "cyclic_loose": 0.5e6}
SCATTER = 0.004  # relative scatter of Z, Lambda, A, F and F^t of a test


def make(folder, model, tests=None, strain=1.6):
    """Writes run files of the model in a folder: name -> file. `tests`: names of the campaign's runs, default all."""
    rng = np.random.default_rng(1)
    campaign = read_campaign(CAMPAIGN)
    specimens = {specimen.name: specimen for specimen in campaign.specimens}
    made = {}
    for run in campaign.runs:
        factors = 1.0 + SCATTER * rng.normal(size=5)  # drawn for every test, so that they do not depend on `tests`
        if tests is not None and run.name not in tests:
            continue
        specimen, path = specimens.get(run.specimen), run.path
        e = specimen.recipe.void_ratio if specimen else 0.64
        held = path.pressure if isinstance(path, StressPath) else None
        p = {"isoc": 0.2e6, "isod": 1e6}.get(path.name) or held or STARTS.get(run.specimen, 0.4e6)
        given = {"reversals": path.reversals} if path.name == "cyclic_cp" else {}
        if path.name in SHEAR:
            given["strain"] = f"{100.0 * strain} %" if path.strain == type(path).strain else path.strain
        reading = model.reading(beyond_e_cmax="flat")
        result = drive(
            reading,
            model_path(path.name, p, **given),
            isotropic_state(reading, e, p),
            record_strain=5e-3 if path.name in SHEAR else None,
        )
        file = folder / f"{run.name}.run.nc"
        write_result(file, scattered(result, factors))
        with changed(file) as dataset:
            dataset.recipe = json.dumps({"void_ratio": e})
            dataset["inertial_number"][:] = 1e-4
            dataset["overlap_ratio"][:] = 0.01
            scene = json.loads(dataset.scene)
            dataset.scene = json.dumps({**scene, "law": "spring_dashpot"})
        made[run.name] = file
    return made


def scattered(result, factors):
    """The Result with the five statistics multiplied by factors (5,), and the stress that C0 predicts from them."""
    vector = result.vector.copy()
    for factor, columns in zip(factors, (1, 2, slice(3, 9), slice(9, 15), slice(15, 21)), strict=True):
        vector[:, columns] *= factor
    changed = dataclasses.replace(result, vector=vector)
    stress = c0_stress(result.model.young_modulus, changed.Z, changed.Lam, changed.e, changed.A, changed.F, changed.Ft)
    return dataclasses.replace(changed, stress=stress)


@pytest.fixture(scope="session")
def known(tmp_path_factory):
    """Name -> run of the full campaign with Table 2, its records in memory."""
    files = make(tmp_path_factory.mktemp("paper"), Model())
    return in_memory({name: labkit.open_run(file) for name, file in files.items()})
