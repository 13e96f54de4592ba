"""Runs that share a batch on the engine cuda, in the simulator: failures, signals, kills, batches of a campaign."""

import os
import signal
import threading

import numpy as np
import pytest

import labkit as lk
from labkit.campaigns.batches import batches_of, carry_out
from labkit.campaigns.file import read_campaign
from labkit.campaigns.plan import plan_of, write_recipes
from labkit.cli.job import simulate, task_of
from labkit.engines.base import Advance, Load, Work
from labkit.errors import Interrupted, PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import write_state
from labkit.runs.batch import execute_together, packed
from labkit.runs.tasks import RunTask
from tests.engines.simulated_gpu import CudaBatches, Pool, Reader, cuda, lattice

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:at the axial strain rate")]

RATE = 200.0  # 1/s
UNSTABLE = Scene(law="spring_dashpot", time_step_factor=9.0)


def strain(steps):
    """Axial strain of a number of time steps."""
    return steps * RATE * lattice(2, 0).time_step


OPTIONS = lk.Options(record_strain=strain(25), snapshots=1, save_every=1, guarded=False)
PATHS = {
    "a": lk.paths.ConstantVolume(strain=strain(100), rate=RATE),
    "b": lk.paths.ConstantVolume(strain=strain(125), rate=RATE),
    "wild": lk.paths.ConstantVolume(strain=strain(100), rate=strain(1) / UNSTABLE.time_step),
}


@pytest.fixture(scope="module")
def tests():
    """Two tests that end at different steps, and one that is unstable: name -> (state, path)."""
    states = {"a": lattice(2, 1), "b": lattice(2, 2), "wild": lattice(2, 3, UNSTABLE)}
    return {name: (state, PATHS[name]) for name, state in states.items()}


@pytest.fixture(scope="module")
def outcomes(tests, tmp_path_factory):
    """The tests in one batch, uninterrupted: name -> Outcome."""
    return lk.run_batch(tests, tmp_path_factory.mktemp("whole"), options=OPTIONS)


def data_hash(run):
    return run.data.attrs["data_sha256"]


def test_a_run_advances_while_another_one_computes_a_record(monkeypatch):
    """Work that fails there ends only its own run."""
    monkeypatch.setattr(Pool, "hurries", True)
    advanced, ends = threading.Event(), {}

    def waits():
        yield Load(lattice(2, 1))
        ends["waited"] = yield Work(advanced.wait, (60.0,))

    def advances():
        yield Load(lattice(2, 2))
        yield Advance(2, np.zeros((3, 3)))
        ends["step"] = (yield lambda engine: engine.state()).step
        advanced.set()

    def fails():
        yield Load(lattice(2, 3))
        yield Work(balance)

    def balance():
        raise PhysicsError("of the record")

    failures = CudaBatches().drive([waits(), advances(), fails()])
    assert failures[:2] == [None, None] and str(failures[2]) == "of the record"
    assert ends == {"waited": True, "step": 2}


def test_what_was_read_stays_when_something_else_is_read():
    reader, values = Reader(), np.arange(24.0).reshape(2, 3, 4)
    of_device = cuda.to_device(values)
    first = reader.read({"a": [of_device[0], of_device[1]], "b": [cuda.to_device(np.int32([7]))]})
    reader.read({"other": [cuda.to_device(np.zeros(100))]})
    assert np.array_equal(first["a"], values) and first["b"].tolist() == [[7]]


def test_batches_fit_the_room_and_mix_no_keys():
    assert packed("aabaa", [3.0, 1.0, 1.0, 2.0, 9.0], 4.0) == [[0, 1], [2], [3], [4]]
    assert packed("", [], 4.0) == []


def test_a_run_that_fails_says_so_and_stops_no_other(outcomes):
    assert [outcomes[name].run.data.sizes["time"] for name in ("a", "b")] == [5, 6]
    assert all(outcomes[name].run.complete and not outcomes[name].failure for name in ("a", "b"))
    assert "NaN" in outcomes["wild"].failure and not outcomes["wild"].run.complete


def two_tasks(tests, folder):
    return [
        RunTask(
            lk.Cuda(), output=str(folder / f"{name}.run.nc"), state=tests[name][0], path=tests[name][1], options=OPTIONS
        )
        for name in ("a", "b")
    ]


def sender(number):
    """A progress function that sends this process a signal in the middle of a run."""
    return lambda done, text: os.kill(os.getpid(), number) if 0.4 < done < 0.6 else None


def require_started(folder):
    """The runs in a folder are unfinished."""
    runs = [lk.Run.open(folder / f"{name}.run.nc") for name in ("a", "b")]
    assert all(not run.complete and run.data.sizes["time"] > 1 for run in runs)


def test_a_signal_saves_all_runs_and_each_resumes_alone_with_the_same_bits(tests, outcomes, tmp_path):
    with pytest.raises(Interrupted, match=f"stopped by signal {int(signal.SIGTERM)}; the runs are saved") as stopped:
        execute_together(two_tasks(tests, tmp_path), 2 * [sender(signal.SIGTERM)])
    assert stopped.value.code == 128 + signal.SIGTERM
    require_started(tmp_path)
    for name in ("a", "b"):
        file = tmp_path / f"{name}.run.nc"
        run = lk.run(*tests[name], engine="cuda", file=file, progress=False, options=OPTIONS)
        assert data_hash(run) == data_hash(outcomes[name].run)


def test_runs_of_a_killed_batch_resume_with_the_same_bits(tests, outcomes, tmp_path, monkeypatch):
    child = os.fork()
    if child == 0:
        execute_together(two_tasks(tests, tmp_path), 2 * [sender(signal.SIGKILL)])
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    require_started(tmp_path)
    monkeypatch.setattr(Pool, "hurries", True)  # one run continues its steps while another one computes a record
    resumed = lk.run_batch({name: tests[name] for name in ("a", "b")}, tmp_path, options=OPTIONS)
    assert all(data_hash(resumed[name].run) == data_hash(outcomes[name].run) for name in ("a", "b"))


CAMPAIGN = f"""\
engine: cuda
law: spring_dashpot
snapshots: 1
gpu_memory: 0.5 GB
specimens:
  small: {{void_ratio: 0.67, grains: 100, engine: fused}}
  large: {{void_ratio: 0.67, grains: 90000, engine: fused}}
runs:
  one: {{path: cv, specimen: small, strain: {strain(100)}, rate: {RATE}, record_strain: 1}}
  bad: {{path: cv, specimen: small, strain: 0.01, rate: 20, time_step_factor: 9}}
  big: {{path: cv, specimen: large, strain: 0.01}}
  loud: {{path: cv, specimen: large, strain: 0.02}}
  slippery: {{path: cv, specimen: large, strain: 0.02, friction: 0}}
"""


def test_a_campaign_packs_its_runs_into_batches_and_a_failed_run_stops_no_other(tmp_path, monkeypatch):
    (tmp_path / "c.yaml").write_text(CAMPAIGN)
    plan = plan_of(read_campaign(tmp_path / "c.yaml"))
    batches = batches_of(plan)
    assert [[job.name for job in batch.jobs] for batch in batches] == [["one", "bad", "big", "loud"], ["slippery"]]
    assert [round(batch.memory / 1e9, 1) for batch in batches] == [0.4, 0.2]
    (tmp_path / "c.yaml").write_text(CAMPAIGN.replace("0.5 GB", "0.2 GB"))
    less = batches_of(plan_of(read_campaign(tmp_path / "c.yaml")))
    assert sorted(len(batch.jobs) for batch in less) == [1, 1, 3]

    monkeypatch.chdir(tmp_path)
    write_recipes(plan, ".")
    for name in ("small", "large"):
        write_state(f"specimens/{name}.state.nc", lattice(2, 4))
    one, bad = batches[0].jobs[:2]
    batch = type(batches[0])("tried", (one, bad), 0.0)
    carry_out(batch, task_of)
    assert (tmp_path / batch.mark).exists()
    assert "the time step" in (tmp_path / bad.log).read_text()
    finished = (tmp_path / one.unfinished).read_bytes()
    assert [simulate(one), simulate(bad)] == [0, 1]
    assert lk.Run.open(one.output).complete and not (tmp_path / bad.output).exists()
    assert (tmp_path / one.output).read_bytes() == finished
    assert "time_step_factor" in (tmp_path / bad.log).read_text()
