"""Checks for a usable GPU, and compiles functions for it with numba-cuda."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from typing import Any, Protocol

from labkit.engines.kernel.compiling import Function, Version, callees, use_operators, with_globals
from labkit.errors import InputError

try:
    cuda: Any = importlib.import_module("numba.cuda")  # type checkers do not understand its types
except ImportError:  # future versions of numba may move it to numba-cuda
    cuda = None
SIMULATED = (
    cuda is not None and "simulator" in cuda.jit.__module__
)  # kernels run as plain Python, to test without a GPU

if cuda is not None and not SIMULATED:
    extending = importlib.import_module("numba.cuda.extending")
    if hasattr(extending, "overload"):  # numba's own numba.cuda lacks it; require_device asks for numba-cuda
        use_operators(extending.overload, cuda.types)

SLICE = 8 if SIMULATED else 32  # consecutive grains whose neighbour lists are interleaved: a warp
# Threads per block, a multiple of SLICE; each thread of the simulator costs time
BLOCK = 2 * SLICE if SIMULATED else 128

warnings.filterwarnings("ignore", message="Grid size")  # kernels with a thread per state use little of the GPU


class DeviceKernel(Protocol):
    """A kernel: kernel[blocks, threads, stream](arguments) launches it."""

    def __getitem__(self, launch: tuple[object, ...]) -> Callable[..., None]: ...


def require_device() -> None:
    """Raise InputError if Numba finds no usable GPU."""
    if cuda is None or not cuda.is_available():
        raise InputError(
            "the engine cuda needs an NVIDIA GPU with its driver, and numba-cuda: pip install 'labkit[cuda]', or "
            "choose the engine fused"
        )


def on_device(function: Function) -> Function:
    """Compile one function for the device; in the simulator it stays plain Python unless it uses numba.cuda."""
    plain = SIMULATED and "cuda" not in function.__code__.co_names
    return function if plain else cuda.jit(function, device=True)


def kernel(function: Function, names: dict[str, object], version: Version) -> DeviceKernel:
    """Compile a kernel and the functions that it calls, after redefining the global names in `names`."""
    fresh = with_globals(function, names, version)
    return cuda.jit(with_globals(fresh, callees(fresh, {}, version, on_device), version))
