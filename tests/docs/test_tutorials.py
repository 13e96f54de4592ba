"""Every tutorial runs, and its cells print the numbers given in its text."""

import os
import subprocess
import sys

import pytest

from tests.conftest import PATIENCE
from tests.docs.pages import DOCS

pytestmark = pytest.mark.slow

TUTORIALS = sorted((DOCS / "tutorials").glob("[01]*.md"))


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_runs(page, tmp_path):
    folder = tmp_path / "docs" / "tutorials"
    folder.mkdir(parents=True)
    (tmp_path / "examples").symlink_to(DOCS.parent / "examples")
    environment = os.environ | {"PYTHONPATH": str(DOCS.parent)}
    command = [sys.executable, "-m", "tests.docs.tutorial", page]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, cwd=folder, env=environment, check=False
    )
    text = done.stdout + done.stderr
    assert done.returncode == 0 and "Traceback" not in text, text[-3000:]
    for promise in PROMISES[page.stem]:
        assert promise in text


PROMISES = {  # sentences of the text about the output of cells
    "01_first_test": ("friction -0.5", "cp on fused", "True", "Run(cv on fused, complete"),
    "02_c0_and_love": ("the same as lk.sff_stress: True", "C0 against Love", "energy balance"),
    "03_your_own": ("Run(constant_axial_stress on fused, complete", "Run(steps on fused, complete", "0.58 to 1.62"),
    "04_probes": ("elastic", "asymmetry"),
    "05_campaign": ("strian", "cp-dense-p200kPa"),
    "06_model_and_fe": ("q/p at the end: 0.9", "labkit_umat.f90", "[1. 1. 1. 1.]"),
    "07_large_specimens": ("core hours", "in mixed precision"),
    "08_from_the_laboratory": ("cr on laboratory", "TMD22: largest q/p 1.73", "rolling_friction"),
    "09_triaxial_of_a_sand": ("dense: complete True", "loose: complete True", "D_r = 75 %"),
    "10_liquefaction": ("CSR 0.2: r_u > 0.95 after", "cycles, largest r_u"),
}
