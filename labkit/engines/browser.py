"""Builds the wheel of labkit for browsers: its Python, with the kernel and all contact laws as WebAssembly.

    python -m labkit.engines.browser FOLDER

writes labkit-VERSION-py3-none-any.whl into FOLDER. Numba and LLVM compile the functions, zig (pip install ziglang) the
host. Python in a browser (Pyodide) installs the wheel like any other, and loads the library with ctypes.
"""

from __future__ import annotations

import base64
import hashlib
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from labkit.engines.host import build
from labkit.engines.kernel.ship import WASM, ship
from labkit.version import __version__

PACKAGE = Path(__file__).parents[1]
OF_INSTALLATION = ("RECORD", "WHEEL", "INSTALLER", "REQUESTED", "direct_url.json")
WHEEL = "Wheel-Version: 1.0\nGenerator: labkit\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def build_wheel(folder: Path) -> Path:
    """Build the wheel in a folder and return its path. Raises CannotCompile."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="labkit-") as scratch:
        objects = Path(scratch, "objects")
        ship(objects, (WASM,))
        return write_wheel(folder, build.build_for_browsers(Path(scratch), sorted(objects.glob("*.o"))))


def write_wheel(folder: Path, library: Path) -> Path:
    """Write the wheel with a library for browsers into a folder and return its path."""
    wheel, record = folder / f"labkit-{__version__}-py3-none-any.whl", f"labkit-{__version__}.dist-info/RECORD"
    lines = []
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files_of(library):
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
            lines.append(f"{name},sha256={digest},{len(content)}\n")
            archive.writestr(name, content)
        archive.writestr(record, "".join([*lines, f"{record},,\n"]))
    return wheel


def files_of(library: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the files in the wheel, without its RECORD."""
    for file in sorted(PACKAGE.rglob("*")):
        if file.is_file() and file.suffix not in (".so", ".o", ".pyc"):  # those are for this computer
            yield file.relative_to(PACKAGE.parent).as_posix(), file.read_bytes()
    yield (build.HERE / library.name).relative_to(PACKAGE.parent).as_posix(), library.read_bytes()
    about = f"labkit-{__version__}.dist-info"
    yield f"{about}/WHEEL", WHEEL.encode()
    for installed in metadata.distribution("labkit").files or []:
        if installed.parent.name == about and installed.name not in OF_INSTALLATION:
            yield installed.as_posix(), installed.read_binary()


if __name__ == "__main__":
    print(build_wheel(Path(sys.argv[1])))
