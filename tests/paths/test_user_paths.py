"""User-defined paths: plane strain, extension, and directions that are refused."""

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.paths.registry import PATHS
from labkit.paths.step import Here
from labkit.records.schedule import Options, Schedule

pytestmark = pytest.mark.slow

PROGRAM = Path(__file__).with_name("user_paths.py")


@pytest.fixture(scope="module")
def state_file(tmp_path_factory, loose_specimen):
    file = tmp_path_factory.mktemp("state") / "s.state.nc"
    lk.write_state(file, loose_specimen)
    return file


@pytest.fixture
def run_program(forks):
    """Function that returns the JSON that the program prints last."""

    def printed(*arguments):
        environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(PROGRAM.parents[2])}
        done = forks.run(*arguments, environment=environment, program=PROGRAM)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return printed


REFUSED = [(0.5, 0.5, -1.0), (0, 1), (0.0, 0.0, float("nan")), "abc", None]


@pytest.mark.parametrize("wrong", REFUSED, ids=str)
def test_a_direction_whose_axial_rate_is_negative_is_refused(wrong):
    """It is refused when the class is registered, when it is used unregistered, and when it replaces the check."""

    @dataclasses.dataclass(frozen=True)
    class Wrong(lk.Path):
        name = "test_wrong"
        direction = wrong

    with pytest.raises(InputError) as registered:
        lk.register_path(Wrong)
    with pytest.raises(InputError) as created:
        Wrong(strain=0.01)
    for error in (registered.value, created.value):
        assert error.field == "direction"

    @dataclasses.dataclass(frozen=True)
    class Unchecked(Wrong):
        def __post_init__(self):
            pass

    with pytest.raises(InputError, match="direction"):
        Schedule.of(Unchecked(rate=10.0, strain=0.01), 1e-7, 200, Options())
    assert "test_wrong" not in PATHS


def test_the_sign_of_the_strain_is_that_of_the_rates():
    """This also holds for a path that prescribes only a lateral strain rate."""

    @dataclasses.dataclass(frozen=True)
    class Lateral(lk.Path):
        name = "test_lateral"
        direction = (1.0, 0.0, 0.0)

    @dataclasses.dataclass(frozen=True)
    class Extension(Lateral):
        strain: float = lk.parameter(-0.01, low=-1.0, high=-1e-6, help="strain to reach")

    for path, sign in ((Lateral(rate=10.0, strain=0.01), 1.0), (Extension(rate=10.0), -1.0)):
        (step,) = path.steps_from(Here())
        assert (step.rates(0.0) == np.diag([sign, 0.0, 0.0])).all()
