"""Machine code of functions: compiled by Numba, stored in files, and loaded without Numba.

A function becomes a C function of pointers (numba.cfunc). LLVM writes the code to an object file. The name of the file
is a hash of everything on which the code depends, so a later process that finds the file does not import Numba. Files
are written completely or not at all. If the folder is not writable, every process compiles again. If several processes
or threads need the same function, one of them compiles it while the others wait, at most PATIENCE seconds.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

with contextlib.suppress(ImportError):  # a browser compiles nothing
    import llvmlite.binding as llvm

    from labkit.engines.kernel.object_code import emit_object

from labkit.engines.kernel.frozen import Function
from labkit.engines.kernel.host import address_in_library, level
from labkit.engines.kernel.translate import OPTIONS, Untyped, load_numba
from labkit.errors import InputError, notice
from labkit.files.caches import cache_folder, private_folder, read_private
from labkit.once import LOCK, once
from labkit.process.interruption import signal_caught
from labkit.process.system import lock_file

SHIPPED = Path(__file__).parent / "objects"  # files that labkit.engines.kernel.ship wrote into the wheel
COMPILES = sys.platform != "emscripten"  # in a browser the library contains the code of all functions (ship.py)
PATIENCE = 20.0  # s; a process that compiles may be stopped, as by Ctrl-Z
_LOADED: dict[
    tuple[str, bytes], tuple[Untyped, int]
] = {}  # name, code -> engine, address; references: LLVM frees the code together with its engine


@once
def target_processor() -> tuple[str, str]:
    """Return name and features of the processor, which let LLVM use its full vector width."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if "NUMBA_CPU_NAME" in os.environ:  # Numba compiles for a different processor (labkit.engines.kernel.ship)
        return os.environ["NUMBA_CPU_NAME"], os.environ.get("NUMBA_CPU_FEATURES", "")
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten() + ",-prefer-256-bit"


def new_machine() -> Untyped:
    """Return LLVM's code generator for this processor; the engine that receives it owns it."""
    name, instructions = target_processor()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(name, instructions, opt=3, reloc="pic", codemodel="default", jit=True)


@functools.cache
def versions() -> str:
    """Return the versions of the compilers and the processor, on which machine code depends."""
    return repr((importlib.metadata.version("numba"), importlib.metadata.version("llvmlite"), *target_processor()))


def address_of(
    name: str, write: Callable[[], tuple[Function, Untyped]], stamp: str | None, options: dict[str, Untyped] = OPTIONS
) -> int:
    """Return the address of a function in machine code, loaded from its file or compiled now and stored there.

    Raises MayFail if the code could fail, InputError if a browser does not have it.

    Args:
        name: Name of the function, a word.
        write: Returns the function for Numba and its signature.
        stamp: Text that determines the code; if None, the code is not stored.
        options: Options of numba.cfunc.
    """
    if not COMPILES:
        return _linked(name, stamp)
    with LOCK:
        file = None if stamp is None else code_file(name, stamp)
        stored = [] if stamp is None else [SHIPPED / shipped_name(name, stamp, level())]
        if address := _load_stored(name, stored if file is None else [file, *stored]):
            return address
        with _alone(file):
            if address := _load_stored(name, [] if file is None else [file]):
                return address
            code = compile_code(name, *write(), new_machine(), options)
            if address := _load_stored(name, [] if file is None else [file]):
                return address  # a process that did not wait longer was faster: all go on with one code
            if file is not None:
                write_code(file, code)
        return load_function(name, code)


def _load_stored(name: str, files: Iterable[Path]) -> int:
    """Return the address of a function from the first file that contains it; 0 if none does."""
    return next(filter(None, (load_function(name, code) for file in files if (code := read_code(file)))), 0)


def is_kept(name: str, stamp: str) -> bool:
    """Return True if the code of a function with a stamp is stored in a file."""
    if not COMPILES:
        return True
    file = code_file(name, stamp)
    return bool(file and file.exists()) or (SHIPPED / shipped_name(name, stamp, level())).exists()


def _linked(name: str, stamp: str | None) -> int:
    """Return the address of a function in the library. Raises InputError."""
    address = 0 if stamp is None else address_in_library(symbol_of(name, stamp))
    if not address:
        raise InputError(
            "a browser compiles nothing, and has machine code only for labkit's own contact laws in double precision: "
            "give one of these, or use labkit on a computer"
        )
    return address


def symbol_of(name: str, stamp: str) -> str:
    """Return the name of a function in the library of a browser."""
    return shipped_name(name, stamp, "plain").removesuffix(".o").replace("-", "_")


def shipped_name(name: str, stamp: str, level: str) -> str:
    """Return the file name of machine code in the wheel, for all processors of a level."""
    return f"{name}-{hashlib.sha256(f'{level}{stamp}'.encode()).hexdigest()[:32]}.o"


def code_file(name: str, stamp: str) -> Path | None:
    """Return the file for the machine code of a function, or None if there is no folder."""
    digest = hashlib.sha256("\n".join([name, versions(), stamp]).encode()).hexdigest()[:32]
    folder = compiled_folder()
    return folder and folder / f"{name}-{digest}.o"


def hash_files(files: Iterable[str | Path]) -> str:
    """Return a hash of the contents of files."""
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in sorted(map(str, files)))).hexdigest()


@functools.cache
def compiled_folder() -> Path | None:
    """Return the folder of compiled code, or None; only this user may write to it, because labkit executes the code."""
    place = os.environ.get("NUMBA_CACHE_DIR")
    if not place:
        return cache_folder("compiled")
    folder = private_folder(Path(place))
    return folder and private_folder(folder / "labkit")


def read_code(file: Path) -> bytes | None:
    """Return the code in a file, or None if it is missing, incomplete, or stored under another name."""
    try:
        data = file.read_bytes() if file.parent == SHIPPED else read_private(file)
    except OSError:
        return None
    code, digest = data[:-32], data[-32:]
    return code if _digest(file, code) == digest else None


def _digest(file: Path, code: bytes) -> bytes:
    """Return the hash at the end of a file of code, which covers the name of the file too."""
    return hashlib.sha256(file.name.encode() + code).digest()


def write_code(file: Path, code: bytes) -> None:
    """Write machine code to a file, with a hash of both; a folder that cannot be written is no error."""
    fresh = file.with_suffix(f".{os.getpid()}")
    with contextlib.suppress(OSError):
        try:
            with open(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as handle:
                handle.write(code + _digest(file, code))
            fresh.replace(file)  # other processes see the complete file or no file
        finally:
            fresh.unlink(missing_ok=True)


@contextlib.contextmanager
def _alone(file: Path | None) -> Iterator[None]:
    """Let only one process compile a function, while other processes wait for its file, if any, but not for ever."""
    if file is None:
        yield
        return
    lock, held = file.with_suffix(".lock"), None
    with contextlib.suppress(OSError):  # raised by a folder without write access or a file system without locks
        held = os.open(lock, os.O_CREAT | os.O_RDWR, 0o600)
        _wait_for(held)
    try:
        yield
    finally:
        if held is not None:
            with contextlib.suppress(OSError):
                lock.unlink()
            os.close(held)


def _wait_for(lock: int) -> None:
    """Lock an open file, or give up after PATIENCE or at a signal. Raises OSError if the system has no locks."""
    end = time.monotonic() + PATIENCE
    while not signal_caught():
        try:
            return lock_file(lock)
        except BlockingIOError:
            if time.monotonic() > end:
                return notice(
                    f"another process has not compiled this code within {PATIENCE:g} s: compiling it here too"
                )
            time.sleep(0.05)


def compile_code(
    name: str, function: Function, signature: Untyped, machine: Untyped, options: dict[str, Untyped] = OPTIONS
) -> bytes:
    """Compile a function under the given name and return the object code. Raises MayFail.

    Args:
        name: Name of the function in the object code.
        function: Function for Numba.
        signature: Its signature.
        machine: LLVM's code generator.
        options: Options of numba.cfunc.
    """
    compiled = load_numba().cfunc(signature, **options)(function)
    return emit_object(compiled.inspect_llvm(), compiled.native_name, name, machine)


def load_function(name: str, code: bytes) -> int:
    """Return the address of a function in object code, 0 if it does not contain the function."""
    key = name, code
    if key not in _LOADED:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), new_machine())
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        _LOADED[key] = engine, engine.get_function_address(name)
    return _LOADED[key][1]


def code_of(addresses: Iterable[int]) -> list[tuple[str, bytes] | None]:
    """Return name and machine code of the functions at some addresses, None for an address of 0."""
    codes = {address: key for key, (_, address) in _LOADED.items()}
    return [codes[address] if address else None for address in addresses]


def load_code(codes: Iterable[tuple[str, bytes] | None]) -> list[int]:
    """Return the addresses of the functions that `code_of` returned, perhaps in another process."""
    return [0 if code is None else load_function(*code) for code in codes]
