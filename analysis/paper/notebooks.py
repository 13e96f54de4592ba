"""Executes the notebooks headless, each in its own kernel, and stores or writes their outputs if requested."""

from __future__ import annotations

import argparse
import base64
import os
import tempfile
from pathlib import Path
from typing import Any

from analysis.places import ROOT, STUDIES, results_folder
from labkit.errors import InputError, PhysicsError
from labkit.files import make_folder, whole_file, write_text
from labkit.process import without_current_folder

LIMIT = 1800  # seconds per cell
INLINE = "module://matplotlib_inline.backend_inline"  # figures become outputs; labkit commands use Agg
RESULTS = "LABKIT_RESULTS"  # environment variable with the data folder, read by the notebooks


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab notebooks`."""
    parser.add_argument(
        "folder",
        metavar="NOTEBOOKS",
        nargs="?",
        default=os.path.relpath(STUDIES),
        help="a notebook, or a folder with notebooks (default: analysis)",
    )
    parser.add_argument(
        "--results", default=results_folder("paper"), help="folder with the data (default: results/paper)"
    )
    parser.add_argument("-o", "--output", help="folder for the executed notebooks and their figures (default: none)")
    parser.add_argument(
        "--store", action="store_true", help="store the new outputs in the notebooks themselves (default: leave them)"
    )


def main(options: argparse.Namespace, command: str) -> None:
    """Executes a notebook, or the notebooks in a folder. Without -o or --store, no file changes."""
    output = Path(make_folder(options.output, "--output")) if options.output else None
    for file in notebook_files(options.folder):
        notebook = execute(file, options.results)
        if options.store:
            write(notebook, file)
        if output is not None:
            write(notebook, output / file.name)
            for k, picture in enumerate(pictures(notebook), 1):
                with whole_file(output / f"{file.stem}_{k}.png") as temporary:
                    Path(temporary).write_bytes(picture)
        print(f"{file}: done", flush=True)


def notebook_files(place: str | Path) -> list[Path]:
    """List a notebook, or the notebooks in a folder, sorted by name. Raises InputError if there are none."""
    if Path(place).is_file() and Path(place).suffix == ".ipynb":
        return [Path(place)]
    files = sorted(Path(place).glob("*.ipynb"))
    if not files:
        raise InputError(
            f"{place} contains no notebooks: give a notebook, or use the `analysis` folder of labkit's repository"
        )
    return files


def execute(file: str | Path, results: str | Path) -> Any:
    """Executes a notebook with the data of the folder `results`, and returns it without volatile metadata.

    The file is not changed. Raises PhysicsError if a cell fails, InputError if Jupyter's packages are not installed.
    """
    try:
        import nbformat
        from nbclient import NotebookClient
        from nbclient.exceptions import CellExecutionError
        from traitlets.config import Config
    except ImportError:
        raise InputError("notebooks need packages that are not installed: pip install 'labkit[notebooks]'") from None
    own = {RESULTS: str(Path(results).resolve()), "MPLBACKEND": INLINE}
    environment = {**without_current_folder(os.environ, str(ROOT)), **own}
    notebook = nbformat.read(file, as_version=4)
    metadata = notebook.metadata.copy()
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        client = NotebookClient(
            notebook,
            timeout=LIMIT,
            startup_timeout=LIMIT,
            kernel_name="python3",
            record_timing=False,
            resources={"metadata": {"path": str(Path(file).parent)}},
            extra_arguments=["--IPKernelApp.log_level=40"],  # hide warnings of the kernel
            config=Config(KernelManager={"transport": "ipc", "ip": f"{folder}/kernel"}),  # no ports
        )
        try:
            client.execute(env=environment)
        except CellExecutionError as error:
            raise PhysicsError(f"{file}: {error.ename}: {error.evalue}") from None
    notebook.metadata = metadata  # removes the versions of the kernel
    for cell in notebook.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = _merged(cell.outputs)
    return notebook


def _merged(outputs: list[Any]) -> list[Any]:
    """Outputs of a cell with consecutive pieces of text joined; how a kernel divides its text is random."""
    merged: list[Any] = []
    for output in outputs:
        if output.output_type == "stream" and merged and merged[-1].get("name") == output.name:
            merged[-1].text += output.text
        else:
            merged.append(output)
    return merged


def pictures(notebook: Any) -> list[bytes]:
    """PNG images among the outputs of a notebook, in order."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return [base64.b64decode(output.data["image/png"]) for output in outputs if "image/png" in output.get("data", {})]


def write(notebook: Any, file: Path) -> None:
    """Writes a notebook."""
    import nbformat

    write_text(file, nbformat.writes(notebook) + "\n")
