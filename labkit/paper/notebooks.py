"""Executes notebooks headless, each in a kernel of its own; they leave their figures."""

from __future__ import annotations

import os
from pathlib import Path

from labkit.errors import InputError, PhysicsError
from labkit.io.files import make_folder

LIMIT = 600  # seconds for one cell
RESULTS, FIGURES = "LABKIT_RESULTS", "LABKIT_FIGURES"  # environment variables that the notebooks read


def notebook_files(folder):
    """The notebooks of a folder, in order. Raises InputError when there are none."""
    files = sorted(Path(folder).glob("*.ipynb"))
    if not files:
        raise InputError(f"{folder} holds no notebooks: give the folder analysis of labkit's repository")
    return files


def execute(file, results, output):
    """Executes a notebook with the data of the folder `results`; its figures go into the folder `output`.

    The notebook file stays as it is. Raises PhysicsError when a cell fails, InputError when Jupyter's packages are
    not installed.
    """
    try:
        import nbformat
        from nbclient import NotebookClient
        from nbclient.exceptions import CellExecutionError
    except ImportError:
        raise InputError("notebooks need packages that are not installed: pip install 'labkit[notebooks]'") from None
    places = {RESULTS: str(Path(results).resolve()), FIGURES: str(make_folder(output, "--output").resolve())}
    notebook = nbformat.read(file, as_version=4)
    client = NotebookClient(
        notebook, timeout=LIMIT, kernel_name="python3", resources={"metadata": {"path": str(Path(file).parent)}},
        extra_arguments=["--IPKernelApp.log_level=40"],  # its warnings are not about notebooks
    )
    try:
        client.execute(env={**os.environ, **places})
    except CellExecutionError as error:
        raise PhysicsError(f"{file}: {error.ename}: {error.evalue}") from None
    return notebook
