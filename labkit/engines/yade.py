"""The reference engine: YADE in a periodic cell, and how YADE is found. Its process runs yade_scripts/server.py."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from labkit.engines.base import Abilities
from labkit.engines.server import Message, ServedEngine, Server, Values, start_process
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.cells import widths

PACKAGE = Path(__file__).resolve().parents[1]
PROGRAMS = ("yade", "yadedaily")


def yade_program() -> str | None:
    """Return the path of the yade program, or None if YADE is not installed.

    labkit searches the folders in $PATH (which include an active conda environment), then the folder of the Python
    interpreter, then $CONDA_PREFIX/bin (for labkit in a conda environment that is not active). `yadedaily` is the
    program in YADE's own Debian packages.
    """
    beside = [str(Path(sys.executable).parent)]
    conda = [str(Path(os.environ["CONDA_PREFIX"]) / "bin")] if os.environ.get("CONDA_PREFIX") else []
    programs = (shutil.which(name, path=place) for place in (None, *beside, *conda) for name in PROGRAMS)
    return next(filter(None, programs), None)


def find_yade() -> str:
    """Return the path of the yade program. Raises InputError with installation instructions if it is missing."""
    program = yade_program()
    if program is None:
        raise InputError(
            "YADE is not installed: on Debian or Ubuntu install it with `./lab` or `sudo apt-get install yade`; "
            "elsewhere see https://yade-dem.org/doc/installation.html"
        )
    return program


def find_script(name: str) -> Path:
    """Return the path of a script in yade_scripts, next to the package in a clone and inside it when installed."""
    for folder in (PACKAGE.parent / "yade_scripts", PACKAGE / "yade_scripts"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"yade_scripts/{name} is missing from this installation: reinstall labkit")


def yade_environment() -> dict[str, str]:
    """Return the environment of a YADE process, without the variables of a virtual environment.

    Waiting OpenMP threads sleep, because spinning threads halve YADE's speed on a computer busy with other work. Python
    does not look for modules next to the script or in the current folder.
    """
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, "PYTHONSAFEPATH": "1", "HOME": _home()}
    for unwanted in ("PYTHONPATH", "PYTHONHOME", "IPYTHONDIR", "VIRTUAL_ENV", "DISPLAY"):
        environment.pop(unwanted, None)
    return environment


def _home() -> str:
    """Return a home folder with which YADE starts: the user's, or the null device, in which there is no file.

    YADE needs a home folder. If it looks writable and is not, such as /proc, YADE's IPython tries forever.
    """
    home = os.environ.get("HOME", os.devnull)
    with contextlib.suppress(OSError):
        if os.access(home, os.W_OK):
            os.rmdir(tempfile.mkdtemp(prefix=".labkit-", dir=home))
        return home
    return os.devnull


def yade_command(script: Path, arguments: Sequence[str], threads: int = 1) -> list[str]:
    """Return the command that runs a script in YADE without open ports. Raises InputError if YADE is missing."""
    program = find_yade()
    return [*_without_servers(program), program, "-n", "-x", f"-j{threads}", str(script), *arguments]


def _without_servers(program: str) -> list[str]:
    """Return the words before YADE's main program on the command line: its Python and yade_scripts/start_yade.py.

    The list is empty if the program is not written in Python, such as a script on a cluster that starts YADE; server.py
    then closes the ports.
    """
    with open(program, "rb") as file:
        first = file.readline(1000).decode(errors="replace")
    return [*shlex.split(first[2:]), str(find_script("start_yade.py"))] if re.match(r"#!.*python", first) else []


def run_script(script: Path, arguments: Sequence[str], threads: int = 1) -> str:
    """Run a script in YADE and return its output. Raises PhysicsError if it fails."""
    command = yade_command(script, arguments, threads)
    done = subprocess.run(command, env=yade_environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode:
        reason = done.stderr.strip()[-300:]
        raise PhysicsError(f"{script.name} in YADE ended with exit status {done.returncode}: {reason}")
    return done.stdout


VERLET_DISTANCE = 0.1  # fraction of the smallest radius: how far a grain may move before the next neighbour search
CHECKPOINT_WORK = 8_000_000  # grains x time steps between two checkpoints: loading a grain takes as long as 80 steps
CHECKPOINT_STEPS = 200_000  # between two checkpoints: 2 to 10 s for a few grains, at 10 to 50 microseconds per step
FUNCTORS = ("geometry", "physics", "law", "losses", "loading_step")
SOCKET = "LABKIT_YADE"  # environment variable with the number of the socket to the YADE that started this process


def _require_law(scene: Scene) -> None:
    """Raise InputError for a contact law that YADE does not have."""
    if scene.twisting_friction > 0.0:
        raise InputError("has no twisting resistance", field="engine", value="yade", allowed="fused")
    law = scene.contact_law
    if law.yade(scene) is None:
        reasons = [part.not_in_yade for part in law.parts_by_kind.values() if "not_in_yade" in vars(type(part))]
        why = f" ({'; '.join(reasons)})" if reasons else ""
        raise InputError(f"has no contact law {scene.law}{why}", field="engine", value="yade", allowed="fused")


def _require_yade() -> None:
    """Raise InputError if YADE is not installed."""
    if SOCKET not in os.environ:
        find_yade()


class YadeEngine(ServedEngine):
    """YADE with one State loaded."""

    name = "yade"
    abilities = Abilities(
        clumps=True,
        checkpoint_work=CHECKPOINT_WORK,
        checkpoint_steps=CHECKPOINT_STEPS,
        require_scene=_require_law,
        require_computer=_require_yade,
    )

    @classmethod
    def start_server(cls, threads: int) -> Server:
        """Start YADE, or use the YADE that started this process.

        Raises InputError if YADE is not installed, or if the running YADE has a different number of threads.
        """
        number = os.environ.pop(SOCKET, None)
        if number is None:
            return start_yade(threads, find_script("server.py"))
        server = Server("YADE", socket.socket(fileno=int(number)))
        if server.processors != threads:
            running = server.processors
            reason = f"is not valid: this YADE was started with {running}"
            raise InputError(reason, field="threads", value=threads, allowed=f"{running}, or start yade -j{threads}")
        return server

    def load_message(self, state: State) -> tuple[Values, dict[str, np.ndarray]]:
        width, needed = _widths(state.cell, state.radius)
        if width < needed:
            raise InputError(
                f"the cell is {width:.3g} m wide: YADE needs {needed:.3g} m, twice the largest grain plus a margin"
            )
        scene = state.scene
        law = scene.contact_law.yade(scene)
        assert law is not None, "`require` has accepted the contact law"
        sizes, kind = np.unique(state.radius, return_inverse=True)
        if not scene.blocked_motions:  # not for discs, whose stiffness is independent of their size
            sizes, kind = state.radius[:1], np.zeros(len(state.radius), dtype=int)
        return {
            "law": {name: getattr(law.functors, name) for name in FUNCTORS} | {"history": law.history},
            "materials": [law.material(radius) for radius in sizes.tolist()],
            "damping": scene.contact_law.local_damping(scene) or 0.0,
            "blocked": scene.blocked_motions,
            "verlet_distance": -VERLET_DISTANCE,  # a negative value is a multiple of the smallest radius
        }, {"material": kind, **(state.bodies.for_engine(scene.density) if state.bodies is not None else {})}

    def state(self) -> State:
        state = super().state()
        if state.clumps is None:
            return state
        motion = state.position, state.velocity, state.angular_velocity
        return state.replace(clumps=state.clumps.after(state.scene.density, *motion, self._extra))

    def _keep(self, answer: Message) -> None:
        """Raise PhysicsError if the cell is narrower than two grains, because YADE's collider then fails."""
        super()._keep(answer)
        width, needed = _widths(self._cell, self._loaded.radius)
        if width < needed:
            raise PhysicsError(
                f"the cell is only {width:.3g} m wide at step {self._step}: YADE needs {needed:.3g} m, twice the "
                "largest grain plus a margin: use a specimen with more grains"
            )


def start_yade(threads: int, script: Path, arguments: Sequence[str] = ()) -> Server:
    """Start a script in YADE as a server; the last argument of the script is the socket."""
    mine, its = socket.socketpair()
    output = tempfile.TemporaryFile()
    with its:
        command = yade_command(script, [*arguments, str(its.fileno())], threads)
        process = start_process(command, env=yade_environment(), stdout=output, pass_fds=[its.fileno()])
    return Server("YADE", mine, process, output)


def _widths(cell: np.ndarray, radius: np.ndarray) -> tuple[float, float]:
    """Return the smallest width (m) of the cell and the width (m) that YADE needs."""
    return widths(cell).min(), 4.0 * radius.max() * (1.0 + VERLET_DISTANCE)
