"""Every tutorial runs, and its cells print what its text says, here with smaller tests than `./lab docs`."""

import os
from pathlib import Path

import pytest

from tests.docs.pages import DOCS

pytestmark = pytest.mark.long

PROGRAM = Path(__file__).with_name("tutorial.py")
TUTORIALS = sorted((DOCS / "tutorials").glob("[01]*.md"))


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_runs(page, forks, tmp_path):
    folder = tmp_path / "docs" / "tutorials"
    folder.mkdir(parents=True)
    source = page.read_text()
    for old, new in SMALLER.get(page.stem, {}).items():
        assert old in source
        source = source.replace(old, new)
    (folder / page.name).write_text(source)
    (tmp_path / "examples").symlink_to(DOCS.parent / "examples")
    environment = {**os.environ, "PYTHONPATH": str(DOCS.parent)}
    done = forks.run(page.name, cwd=folder, environment=environment, program=PROGRAM)
    text = done.stdout + done.stderr
    assert done.returncode == 0 and "Traceback" not in text, text[-3000:]
    for promise in PROMISES[page.stem]:
        assert promise in text


SMALLER = {
    "01_first_test": {"strain=0.05": "strain=0.01"},
    "02_c0_and_love": {"grains=1000": "grains=300"},
    "03_your_own": {"strain=0.02": "strain=0.005"},
    "04_probes": {"directions=8, duration=20": "directions=4, duration=10"},
    "06_model_and_fe": {'strain=0.1, rate="20 1/s"': 'strain=0.05, rate="40 1/s"'},
    "07_large_specimens": {"grains=500": "grains=200"},
    "08_from_the_laboratory": {"posterior.some(3)": "posterior.some(1)"},
    "09_triaxial_of_a_sand": {"grains=200": "grains=100", "strain=0.1": "strain=0.02"},
    "10_liquefaction": {"grains=300": "grains=200", "rate=5": "rate=20"},
}
PROMISES = {  # sentences of the text about the output of cells
    "01_first_test": ("friction -0.5", "cp on fused", "True", "Run(cv on fused, complete"),
    "02_c0_and_love": ("the same as lk.sff_stress: True", "equation by volume: largest error", "energy balance"),
    "03_your_own": ("Run(constant_axial_stress on fused, complete", "Run(steps on fused, complete", "0.58 to 1.62"),
    "04_probes": ("elastic", "asymmetry"),
    "05_campaign": ("strian", "cp-dense-p200kPa"),
    "06_model_and_fe": ("q/p at the end: 0.9", "labkit_umat.f90", "[1. 1. 1. 1.]"),
    "07_large_specimens": ("core hours", "in mixed precision"),
    "08_from_the_laboratory": ("cr, measured in a laboratory", "TMD22: largest q/p 1.73", "rolling_friction"),
    "09_triaxial_of_a_sand": ("dense: complete True", "loose: complete True", "D_r = 75 %"),
    "10_liquefaction": ("CSR 0.2: r_u > 0.95 after", "cycles, largest r_u"),
}
