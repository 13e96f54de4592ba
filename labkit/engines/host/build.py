"""Compiles the host, the C++ library of the fused engine, for the processor architecture of this computer.

The build of the package (hatch_build.py) calls this module, and so does labkit in a checkout whose sources have
changed. The name of the library contains a hash of its sources, so labkit never loads an outdated library. The module
imports nothing from labkit, which is not installed yet when the package is built.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).parent
# no contraction: the sources mark fused multiply-adds explicitly, so results of all compilers are bitwise identical
OPTIONS = ["-O3", "-std=c++17", "-fPIC", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
LIBRARY = ["-fvisibility=hidden", "-Wall", "-Wextra", "-Wno-psabi"]
# level of instructions -> options; `plain`, for any processor, comes first, because the linker takes the first copy of
# functions that all levels share
LEVELS = {
    "v3": ["-march=x86-64-v3", "-mprfchw", "-mtune=skylake"],
    "v4": ["-march=x86-64-v4", "-mprfchw", "-mtune=skylake-avx512"],
}
BROWSER = ["-target", "wasm32-wasi", "-mcpu=generic+simd128+nontrapping_fptoint+bulk_memory", "-fno-exceptions"]
BROWSER += ["-fno-rtti", "-Wno-unknown-pragmas"]
SIDE_MODULE = ["-shared", "--experimental-pic", "--no-entry", "--allow-undefined", "--strip-all"]  # of Pyodide
SIDE_MODULE += ["--export-if-defined=__wasm_call_ctors"]
HASHED = sys.platform == "linux"  # elsewhere nothing may follow the signature of a library
NO_COMPILER = (
    "the kernel of labkit is C++ and is not compiled yet, and there is no C++ compiler: install one (Debian, Ubuntu: "
    "apt-get install g++; otherwise: pip install ziglang), or install labkit from its wheel, which contains the kernel"
)


class CannotCompile(Exception):
    """The host cannot be compiled; the message says what to install."""


def library_name(system: str = platform.system(), machine: str = platform.machine()) -> str:
    """Return the file name of the library of a computer, with a hash of its sources."""
    sources = sorted([*HERE.glob("*.cpp"), *HERE.glob("*.hpp"), HERE / "build.py"])
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    return f"libhost-{system.lower()}-{machine.lower()}-{digest}.so"


def compiler() -> list[str]:
    """Return the command of a C++ compiler: $CXX, g++, c++, clang++ or zig (ziglang). Raises CannotCompile."""
    try:
        compiler = shlex.split(os.environ.get("CXX", ""))
    except ValueError:
        raise CannotCompile(f"CXX={os.environ['CXX']} has a quote without its partner: give CXX=g++, say") from None
    for words in (compiler, ["g++"], ["c++"], ["clang++"]):
        if words and shutil.which(words[0]):
            return words
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-P", "-m", "ziglang", "c++"]
    raise CannotCompile(NO_COMPILER)


def build_host(folder: Path = HERE, extra: Sequence[str] = ()) -> Path:
    """Compile the library into a folder, unless it is there and whole, and return its path. Raises CannotCompile.

    Other processes see the complete library or no library.

    Args:
        folder: Folder of the library.
        extra: Additional options of the compiler, such as `-fsanitize=address`.
    """
    library = folder / library_name()
    if read_whole(library):
        return library
    command = compiler()
    intel = platform.machine().lower() in ("x86_64", "amd64")
    levels = {"plain": [], **(LEVELS if intel else {})}
    with tempfile.TemporaryDirectory(prefix="labkit-") as scratch:
        run = functools.partial(_run, cwd=scratch)
        threads = _threads(command, scratch)
        common = [*command, *OPTIONS, *LIBRARY, *threads, *extra]
        for level, options in levels.items():
            if "ziglang" in command:  # zig has its own names for processors
                options = [options[0].replace("x86-64-", "x86_64_")] if options else []
            run([*common, *options, f"-DLEVEL={level}", "-c", str(HERE / "host.cpp"), "-o", f"{level}.o"])
        run([*common, "-c", str(HERE / "levels.cpp"), "-o", "levels.o"])
        run([*common, "-shared", *(f"{level}.o" for level in levels), "levels.o", "-o", "host.so"])
        fresh = folder / f".{library.name}.{os.getpid()}"
        code = Path(scratch, "host.so").read_bytes()
        fresh.write_bytes(code + (hashlib.sha256(code).digest() if HASHED else b""))
        os.replace(fresh, library)
    return library


def build_for_browsers(folder: Path, objects: Sequence[Path]) -> Path:
    """Compile the library for browsers with zig, link it with compiled functions, and return its path.

    Raises CannotCompile.

    Args:
        folder: Folder of the library.
        objects: Object files of the functions (labkit.engines.kernel.ship).
    """
    if not importlib.util.find_spec("ziglang"):
        raise CannotCompile("the kernel of labkit is compiled for browsers with zig: pip install ziglang")
    zig = [sys.executable, "-P", "-m", "ziglang"]
    library = folder / library_name("Emscripten", "wasm32")
    with tempfile.TemporaryDirectory(prefix="labkit-") as scratch:
        for name in ("host", "levels", "browser"):
            words = [*zig, "c++", *OPTIONS, *LIBRARY, *BROWSER, "-DLEVEL=plain", "-c", str(HERE / f"{name}.cpp")]
            _run([*words, "-o", f"{name}.o"], scratch)
        own = [str(Path(scratch, f"{name}.o")) for name in ("host", "levels", "browser")]
        _run([*zig, "wasm-ld", *SIDE_MODULE, *own, *map(str, objects), "-o", str(library)], scratch)
    return library


def read_whole(library: Path) -> bytes | None:
    """Return the content of a library, or None if it is missing or damaged: its last bytes are a hash of the others."""
    try:
        content = library.read_bytes()
    except OSError:
        return None
    return content if not HASHED or hashlib.sha256(content[:-32]).digest() == content[-32:] else None


def _threads(command: list[str], scratch: str) -> list[str]:
    """Return the options for OpenMP, which Apple's compiler and zig lack: the engine then runs on one thread."""
    source = Path(scratch, "threads.cpp")
    source.write_text("#include <omp.h>\nint main() { return omp_get_max_threads() == 0; }\n")
    words = [*command, "-fopenmp", str(source), "-o", str(Path(scratch, "threads"))]
    tried = subprocess.run(words, capture_output=True, cwd=scratch, check=False)
    return ["-fopenmp"] if tried.returncode == 0 else ["-Wno-unknown-pragmas"]


def _run(words: list[str], cwd: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, cwd=cwd, check=False)
    if done.returncode != 0:
        reason = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
        raise CannotCompile(f"the kernel of labkit cannot be compiled with {shlex.join(words[:1])}: {reason}")


if __name__ == "__main__":
    print(build_host())
