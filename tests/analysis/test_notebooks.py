"""Every notebook of analysis/ runs headless and stores the outputs that its execution produces."""

import io
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image

from analysis.__main__ import main
from analysis.paper.notebooks import execute, notebook_files, pictures
from labkit.errors import InputError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "paper"
NOTEBOOKS = sorted((ROOT / "analysis").glob("*.ipynb"))
SIMULATES = "00_tutorial"  # chaotic: other processors give other digits
there = pytest.mark.skipif(not (RESULTS / "runs").is_dir(), reason="results/paper/runs is not there yet")

ROOMS = ("model", "grains", "paths", "specimens", "records", "micro", "runs", "sff")


def texts(notebook):
    """Text outputs of a notebook, without warnings, which name files of the kernel."""
    outputs = [
        output for cell in notebook.cells for output in cell.get("outputs", []) if output.get("name") != "stderr"
    ]
    return [output.text if output.output_type == "stream" else output.data.get("text/plain") for output in outputs]


def test_one_notebook_or_those_of_a_folder():
    one = ROOT / "analysis" / "03_constant_volume.ipynb"
    assert notebook_files(one) == [one] and one in notebook_files(one.parent)
    with pytest.raises(InputError, match="give a notebook"):
        notebook_files(ROOT / "pyproject.toml")


def different(first, second):
    """Fraction of the pixels of two pictures of the same size that differ by more than font smoothing does."""
    first, second = (np.asarray(Image.open(io.BytesIO(data)).convert("L"), dtype=int) for data in (first, second))
    assert first.shape == second.shape
    return np.mean(np.abs(first - second) > 60)


@there
@pytest.mark.long
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_stored_outputs_are_those_of_an_execution(file):
    stored, executed = nbformat.read(file, 4), execute(file, RESULTS)
    assert [cell.source for cell in executed.cells] == [cell.source for cell in stored.cells]
    assert executed.metadata == stored.metadata
    assert len(texts(executed)) == len(texts(stored))
    if file.stem != SIMULATES:
        assert texts(executed) == texts(stored)
    for new, old in zip(pictures(executed), pictures(stored), strict=True):
        assert different(new, old) < (0.15 if file.stem == SIMULATES else 1e-3)  # a run differs between processors


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_stores_outputs_without_errors_or_volatile_metadata(file):
    notebook = nbformat.read(file, 4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert notebook.cells[0].cell_type == "markdown" and pictures(notebook)
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not any(cell.metadata for cell in notebook.cells) and set(notebook.metadata.language_info) == {"name"}
    outputs = [output for cell in code for output in cell.outputs]
    assert not any(output.output_type == "error" or output.get("name") == "stderr" for output in outputs)
    assert not any(" at 0x" in (text or "") for text in texts(notebook))


def test_all_notebooks_together_are_small():
    assert sum(file.stat().st_size for file in NOTEBOOKS) < 3e6


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_uses_only_public_names_and_shows_its_plotting(file):
    code = "\n".join(cell.source for cell in nbformat.read(file, 4).cells if cell.cell_type == "code")
    assert "analysis" not in code.replace('"analysis"', "") and "plt.subplots" in code and ".plot(" in code
    imports = [line.split()[1] for line in code.splitlines() if line.startswith("from labkit")]
    assert set(imports) <= {
        "labkit.model",
        "labkit.grains",
        "labkit.paths",
        "labkit.specimens",
        "labkit.records",
        "labkit.micro",
        "labkit.results",
        "labkit.sff",
    }


def test_outputs_are_written_and_stored_on_request_only(tmp_path):
    cells = [nbformat.v4.new_code_cell("import matplotlib.pyplot as plt\nplt.plot([1, 2])\nplt.show()\nprint(6 * 7)")]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "a.ipynb")
    before = (tmp_path / "a.ipynb").read_bytes()
    assert main(["notebooks", str(tmp_path)]) == 0
    assert [(each.name, each.read_bytes()) for each in tmp_path.iterdir()] == [("a.ipynb", before)]
    assert main(["notebooks", str(tmp_path), "-o", str(tmp_path / "out"), "--store"]) == 0
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"a.ipynb", "a_1.png"}
    for folder in (tmp_path, tmp_path / "out"):
        assert "42\n" in texts(nbformat.read(folder / "a.ipynb", 4))


def test_a_notebook_that_fails_is_named(tmp_path, capsys):
    broken = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0")])
    nbformat.write(broken, tmp_path / "broken.ipynb")
    assert main(["notebooks", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "broken.ipynb" in error and "division by zero" in error and len(error.splitlines()) == 1


def test_a_folder_without_notebooks(tmp_path, capsys):
    assert main(["notebooks", str(tmp_path)]) == 2
    assert "contains no notebooks" in capsys.readouterr().err
