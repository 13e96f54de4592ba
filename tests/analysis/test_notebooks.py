"""Every notebook of analysis/ runs headless on the stored results and saves its figures."""

import re
import shutil
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image

from analysis.__main__ import main

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "paper"
NOTEBOOKS = sorted((ROOT / "analysis").glob("*.ipynb"))
there = pytest.mark.skipif(not (RESULTS / "runs").is_dir(), reason="results/paper/runs is missing")


def figures_of(file):
    """Names of the figures that the code of a notebook writes."""
    code = "".join(cell.source for cell in nbformat.read(file, 4).cells if cell.cell_type == "code")
    return set(re.findall(r"\{output\}/(\w+\.png)", code))


def alone(file, folder):
    """A folder with only this notebook, in which its relative paths are valid."""
    (folder / "analysis").mkdir()
    (folder / "results").symlink_to(ROOT / "results")
    shutil.copy(file, folder / "analysis")
    return folder / "analysis"


@pytest.mark.parametrize(
    "file", [pytest.param(file, id=file.stem, marks=() if file.stem == "07_model" else there) for file in NOTEBOOKS]
)
def test_runs_and_draws(file, tmp_path):
    figures = tmp_path / "figures"
    arguments = ["notebooks", alone(file, tmp_path), "--results", RESULTS, "-o", figures]
    assert main([str(argument) for argument in arguments]) == 0
    assert {drawn.name for drawn in figures.iterdir()} == figures_of(file) != set()
    for drawn in figures.iterdir():
        assert different(drawn, RESULTS / drawn.name) < 1e-3, f"{drawn.name} differs from the stored picture"


def different(first, second):
    """Share of the pixels of two pictures of equal size that differ by more than font smoothing explains."""
    first, second = (np.asarray(Image.open(file).convert("L"), dtype=int) for file in (first, second))
    assert first.shape == second.shape
    return np.mean(np.abs(first - second) > 60)


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_is_stored_without_outputs_and_describes_its_figures(file):
    cells = nbformat.read(file, 4).cells
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
    drawn = [k for k, cell in enumerate(cells) if cell.cell_type == "code" and "figures.save" in cell.source]
    assert cells[0].cell_type == "markdown" and drawn
    assert all(k + 1 < len(cells) and cells[k + 1].cell_type == "markdown" for k in drawn)


def test_no_two_notebooks_write_the_same_figure():
    names = [name for file in NOTEBOOKS for name in figures_of(file)]
    assert len(names) == len(set(names)) and {f"fig{k}.png" for k in range(1, 11)} <= set(names)


def test_a_notebook_that_fails_is_named(tmp_path, capsys):
    broken = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0")])
    nbformat.write(broken, tmp_path / "broken.ipynb")
    assert main(["notebooks", str(tmp_path), "-o", str(tmp_path / "figures")]) == 1
    error = capsys.readouterr().err
    assert "broken.ipynb" in error and "division by zero" in error and len(error.splitlines()) == 1


def test_a_folder_without_notebooks(tmp_path, capsys):
    assert main(["notebooks", str(tmp_path)]) == 2
    assert "contains no notebooks" in capsys.readouterr().err
