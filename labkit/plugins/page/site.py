"""Writes the page as static files, which any web server can offer."""

from __future__ import annotations

import functools
import hashlib
import json
import shutil
import tempfile
from pathlib import Path

from labkit.engines.base import silent
from labkit.engines.browser import build_wheel
from labkit.engines.host.build import CannotCompile
from labkit.engines.kernel.machine import hash_files
from labkit.errors import InputError, notice
from labkit.files.caches import cache_folder
from labkit.grains.state_file import write_state
from labkit.plugins import module_of_plugin
from labkit.plugins.page.form import Choices, Texts, offered

STATIC = Path(__file__).parent / "static"
EXERCISES = (
    Path(__file__).parent / "exercises.json"
)  # questions, their tests with numbers as labkit gives them, answers
PYODIDE = "https://cdn.jsdelivr.net/pyodide/v0.27.7/full/"
PAPER = "https://doi.org/10.1007/s10035-019-0868-8"


def write_site(folder: Path, wheel: Path | None, pyodide: str | None = None, theory: str = PAPER) -> None:
    """Write the page into a folder.

    Args:
        folder: Folder of the page, created if it is missing.
        wheel: Wheel of labkit for browsers (labkit.engines.browser); without one the page says how to add it.
        pyodide: Folder of Pyodide and NumPy, which is copied into the page (default: the page loads the public one).
        theory: Address of docs/theory.md as a page, or of the paper.
    """
    shutil.copytree(STATIC, folder, dirs_exist_ok=True)
    if wheel is not None:
        shutil.copyfile(wheel, folder / wheel.name)
    if pyodide is not None:
        shutil.copytree(pyodide, folder / "pyodide", dirs_exist_ok=True)
    viewer = module_of_plugin("labkit page", "labkit.plugins.pictures.viewer")
    (folder / "viewer.html").write_text(viewer.empty_page("Grains and contact forces"), encoding="utf-8")
    about = {"pyodide": PYODIDE if pyodide is None else "pyodide/", "wheel": wheel and wheel.name, "theory": theory}
    exercises = json.loads(EXERCISES.read_text(encoding="utf-8"))
    for test in (test for exercise in exercises for test in exercise["tests"]):
        test["specimen"] = specimen_of(test["choices"])
        if wheel is not None and not (folder / test["specimen"]).exists():
            write_state(folder / test["specimen"], Choices.of(test["choices"]).specimen(silent))
    site = {**about, **offered(), "exercises": exercises}
    (folder / "page.json").write_text(json.dumps(site), encoding="utf-8")


def specimen_of(choices: Texts) -> str:
    """Return the name of the file of a specimen: the page loads it, because grains amplify how a computer rounds."""
    specimen = {group: choices[group] for group in choices if group != "path"}
    return f"{hashlib.sha256(json.dumps(specimen, sort_keys=True).encode()).hexdigest()[:12]}.state.npz"


def stored_wheel() -> Path | None:
    """Return the wheel of this version of labkit, if it was built."""
    return next(iter(_folder_of_wheel().glob("*.whl")), None)


def wheel_for_browsers() -> Path:
    """Return the wheel of this version of labkit, which is built at the first use and stored. Raises InputError."""
    if stored := stored_wheel():
        return stored
    notice("building labkit for browsers, which takes some minutes, once")
    folder = _folder_of_wheel()
    try:
        with tempfile.TemporaryDirectory(prefix="labkit-page-") as scratch:
            wheel = build_wheel(Path(scratch))
            folder.mkdir(exist_ok=True)
            return Path(shutil.copy(wheel, folder / "copy")).replace(folder / wheel.name)
    except CannotCompile as error:
        raise InputError(str(error)) from None


@functools.cache
def _folder_of_wheel() -> Path:
    package = Path(__file__).parents[2]
    sources = (file for file in package.rglob("*") if file.suffix in (".py", ".cpp", ".hpp", ".html", ".js", ".css"))
    return (cache_folder("page") or Path(tempfile.mkdtemp(prefix="labkit-page-"))) / hash_files(sources)[:16]
