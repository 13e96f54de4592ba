"""Executes notebooks headless, each in its own kernel, and saves their figures."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from analysis.places import ROOT, STUDIES, results_folder
from labkit.errors import InputError, PhysicsError
from labkit.io import install_command, make_folder

LIMIT = 600  # seconds per cell
RESULTS, FIGURES = "LABKIT_RESULTS", "LABKIT_FIGURES"  # environment variables that the notebooks read


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab notebooks`."""
    parser.add_argument(
        "folder", nargs="?", default=os.path.relpath(STUDIES), help="folder with notebooks (default: analysis)"
    )
    parser.add_argument(
        "--results", default=results_folder("paper"), help="folder with the data (default: results/paper)"
    )
    parser.add_argument("-o", "--output", help="folder for the figures (default: the data folder)")


def main(options: argparse.Namespace, command: str) -> None:
    """Executes the notebooks of a folder."""
    for file in notebook_files(options.folder):
        execute(file, options.results, options.output or options.results)
        print(f"{file}: done", flush=True)


def notebook_files(folder: str | Path) -> list[Path]:
    """Notebooks in a folder, sorted by name. Raises InputError if there are none."""
    files = sorted(Path(folder).glob("*.ipynb"))
    if not files:
        raise InputError(f"{folder} contains no notebooks: use the folder analysis of labkit's repository")
    return files


def execute(file: str | Path, results: str | Path, output: str | Path) -> Any:
    """Executes a notebook with the data of the folder `results`; its figures go to the folder `output`.

    The notebook file is not changed; the executed notebook is returned. Raises PhysicsError if a cell fails,
    InputError if Jupyter's packages are not installed.
    """
    try:
        import nbformat
        from nbclient import NotebookClient
        from nbclient.exceptions import CellExecutionError
    except ImportError:
        raise InputError(f"notebooks need packages that are not installed: {install_command('notebooks')}") from None
    places = {RESULTS: str(Path(results).resolve()), FIGURES: str(make_folder(output, "--output").resolve())}
    python_path = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]  # so that notebooks can import `analysis`
    notebook = nbformat.read(file, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=LIMIT,
        kernel_name="python3",
        resources={"metadata": {"path": str(Path(file).parent)}},
        extra_arguments=["--IPKernelApp.log_level=40"],  # hide warnings of the kernel
    )
    try:
        client.execute(env={**os.environ, **places, "PYTHONPATH": os.pathsep.join(python_path)})
    except CellExecutionError as error:
        raise PhysicsError(f"{file}: {error.ename}: {error.evalue}") from None
    return notebook
