"""Blocks of README.md and the pages run as printed: 25 of them, which every version draws anew.

Each page runs in a fresh process and folder. Its earlier blocks run first, so that a drawn one finds what the reader
has by then; what the reader brings, such as a specimen, is small. blocks.py says which blocks are not run.
"""

import collections
import json
import os
import random
import shutil
import subprocess
import sys

import pytest

import labkit
from tests.conftest import PATIENCE, ROOT
from tests.docs.blocks import blocks
from tests.docs.pages import DOCS

pytestmark = [pytest.mark.long, pytest.mark.yade]

PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
RUNNABLE = [
    (page, number)
    for page in PAGES
    for number, (language, _) in enumerate(blocks(page))
    if language in ("python", "sh")
]
DRAWN = collections.defaultdict(list)
for page, number in random.Random(labkit.__version__).sample(RUNNABLE, 25):
    DRAWN[page].append(number)

READER = """
labkit specimen --preparation compression --pressure 50kPa --step1-friction 0.05 --grains 200 -o s.state.nc
labkit run cv s.state.nc --strain 0.02 -o r.run.nc
labkit run cr s.state.nc --pressure 300kPa --strain 0.02 -o cr.run.nc
for p in 100 300 600; do labkit run cp s.state.nc --pressure ${p}kPa --strain 0.16 --rate 50 -o cp$p.run.nc; done
labkit run isoc s.state.nc --rate 50 -o isoc.run.nc
labkit run isod isoc.run.nc --rate 50 -o isod.run.nc
labkit run oedometer_reloading s.state.nc --stresses 100kPa -o k0.run.nc
mkdir results
cp cp100.run.nc results/cp-dense.run.nc; cp cp300.run.nc results/cp-loose.run.nc
cp r.run.nc cv.run.nc; cp r.run.nc s_1.run.nc; cp cp100.run.nc dense.run.nc; cp cp300.run.nc loose.run.nc
labkit specimen --void-ratio 0.67 --grains 200 --cell fixed -o fixed.state.nc
labkit export fixed.state.nc --format sphere_pack -o packing.txt
printf 'diameter_mm,passing_percent\\n1,0\\n1.5,50\\n2,100\\n' >curve.csv
cat >mine.yaml <<END
engine: fused
specimens:
  dense: {void_ratio: 0.62, grains: 100}
  sand:
    {void_ratio: 0.7, grains: 100, preparation: compression, pressure: 100 kPa, friction: [0.3, 0.6],
     step1_friction: [0, 0.5]}
runs:
  cr: {path: cr, specimen: sand, pressure: 100 kPa, strain: 0.01}
  cp-dense-fused: {path: cp, specimen: dense, pressure: 1 MPa, strain: 0.01}
END
labkit campaign mine.yaml --cores 1
"""


def folder_of_a_reader(folder):
    """The commands `labkit`, `python` and, as in a clone, ./lab, and what the pages name of the clone."""
    (folder / ".venv/bin").mkdir(parents=True)
    for name, words in (("python", ""), ("labkit", "-P -m labkit.cli")):
        (folder / ".venv/bin" / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        (folder / ".venv/bin" / name).chmod(0o755)
    shutil.copy(ROOT / "lab", folder)
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copy(ROOT / "pyproject.toml", folder / ".venv/installed")
    shutil.copytree(ROOT / "examples", folder / "examples")
    for name in ("analysis", "docs", "labkit", "yade_scripts"):
        (folder / name).symlink_to(ROOT / name)
    path = f"{folder / '.venv/bin'}:{os.path.dirname(sys.executable)}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """Folder with the files that the pages say their reader has."""
    folder = tmp_path_factory.mktemp("reader")
    shutil.copy(ROOT / "results/model_benchmark/better.json", folder / "calibrated.json")
    environment = folder_of_a_reader(tmp_path_factory.mktemp("clone") / "clone")
    subprocess.run(["sh", "-ec", READER], cwd=folder, env=environment, check=True, timeout=PATIENCE)
    return folder


@pytest.mark.parametrize("page", DRAWN, ids=lambda page: page.stem)
def test_the_blocks_drawn_for_this_version_run_as_printed(page, reader, tmp_path):
    environment = folder_of_a_reader(tmp_path / "clone")
    command = [sys.executable, "-P", "-m", "tests.docs.blocks", page, json.dumps(DRAWN[page]), reader]
    done = subprocess.run(
        command, cwd=tmp_path / "clone", env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
