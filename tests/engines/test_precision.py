"""Mixed precision on the fused engine: its agreement with double precision, and its mention in files and commands."""

import dataclasses

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel.translate import to_single
from labkit.errors import InputError
from labkit.files.schema import STATE
from labkit.grains.laws.vectors import inverse_root_single
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import write_state
from labkit.plugins.campaigns.file import read_campaign
from labkit.servo.plan import prescribed_gradient

R = 85e-6
CV = lk.paths.ConstantVolume(strain=0.003, rate=100.0)  # so fast that rounding errors hardly grow

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:at the axial strain rate")]


def gradient(state):
    return prescribed_gradient(lk.paths.ConstantVolume(rate=10.0), state.time_step)


def identical(a, b):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in STATE) and a.ledger == b.ledger


@pytest.fixture(scope="module")
def runs(soft_specimen, tmp_path_factory):
    """A CV test in each precision: precision -> Run."""
    folder = tmp_path_factory.mktemp("precision")
    return {
        precision: lk.run(
            soft_specimen,
            CV,
            file=folder / f"{precision}.run.nc",
            progress=False,
            engine=lk.Fused(precision=precision),
            record_strain=3e-4,
        )
        for precision in ("double", "mixed")
    }


def test_stress_ratio_and_energy_balance_are_those_of_double_precision(runs):
    ratio = {name: run.data.lab.stress_ratio().values for name, run in runs.items()}
    difference = np.abs(ratio["mixed"] - ratio["double"])
    assert 0.0 < difference.max() < 1e-4 < 1e-3 * np.ptp(ratio["double"])
    error = {name: np.abs(run.data["energy_balance_error"].values).max() for name, run in runs.items()}
    assert error["mixed"] < 2.0 * error["double"]


def test_small_overlaps_far_from_the_origin_are_accurate():
    """Branches are differences of double positions, and overlaps (R^2 - d^2)/(R + d) with a double numerator."""
    overlap, far = 1e-6 * R, 1e4 * R * np.array([1.0, 1.1, 0.9])
    direction = np.array([2.0, -1.0, 3.0]) / np.sqrt(14.0)
    position = far + np.array([np.zeros(3), (2.0 * R - overlap) * direction])
    state = grains_in_cell(Scene(), np.full(2, R), position, np.eye(3) * 3e4 * R)
    overlap = 2.0 * R - np.linalg.norm(position[1] - position[0])
    force = Scene().normal_stiffness(R, R) * overlap
    expected = force * 2.0 * R * np.outer(direction, direction) / np.linalg.det(state.cell)
    stress = FusedEngine(state, precision="mixed").stress()
    assert np.abs(stress - expected).max() < 1e-5 * np.abs(expected).max()


def test_files_record_any_precision_but_double(runs, soft_specimen, tmp_path):
    for name, run in runs.items():
        assert run.precision == name
        with netCDF4.Dataset(run.file) as dataset:
            assert getattr(dataset, "precision", None) == (None if name == "double" else name)
            assert ('"precision": "mixed"' in dataset.path_parameters) == (name == "mixed")
            assert dataset.specimen == soft_specimen.digest()
    write_state(tmp_path / "double.state.nc", soft_specimen)
    with netCDF4.Dataset(tmp_path / "double.state.nc") as dataset:
        assert "precision" not in dataset.ncattrs()


def test_a_run_cannot_be_continued_in_another_precision(runs, soft_specimen):
    with pytest.raises(InputError, match=r"precision .* mixed"):
        lk.run(
            soft_specimen,
            CV,
            file=runs["double"].file,
            progress=False,
            engine=lk.Fused(precision="mixed"),
            record_strain=3e-4,
        )


@pytest.mark.parametrize(("engine", "precision"), [("yade", "mixed"), ("fused", "single")])
def test_a_precision_that_the_engine_lacks_is_refused(soft_specimen, engine, precision):
    message = f"^precision '{precision}' is not available on the engine {engine}: give "
    for attempt in (
        lambda: lk.run(soft_specimen, CV, engine=Device(engine, precision=precision)),
        lambda: lk.make_specimen(lk.Recipe(0.67, grains=200), engine=Device(engine, precision=precision)),
        lambda: lk.consolidate(soft_specimen, 6e5, engine=Device(engine, precision=precision)),
    ):
        with pytest.raises(InputError, match=message):
            attempt()


def test_campaigns_pass_the_precision_on(tmp_path):
    text = "engine: fused\nspecimens:\n  a: {void_ratio: 0.67, grains: 150}\nruns:\n"
    text += "  r: {path: cp, pressure: 500 kPa, specimen: a}\n"
    digests = []
    for number, head in enumerate(("", "precision: mixed\n")):
        file = tmp_path / f"{number}.yaml"
        file.write_text(head + text)
        jobs = read_campaign(str(file)).jobs
        assert all(("--precision=mixed" in job.command) == bool(head) for job in jobs)
        assert [job.name for job in jobs] == ["a", f"a-at-p500kPa-fused{'-mixed' if head else ''}", "r"]
        digests.append({job.digest for job in jobs})
    assert not digests[0] & digests[1]
    file.write_text("precision: mixed\n" + text.replace("engine: fused", "engine: yade"))
    with pytest.raises(InputError, match=r"precision 'mixed' .*yade.* double"):
        read_campaign(str(file))


def test_inverse_roots_of_single_numbers():
    for x in (1e-30, 2.6e-9, 1.0, 3.7, 1e20):
        assert abs(inverse_root_single(np.float32(x)) * np.sqrt(np.float64(np.float32(x))) - 1.0) < 3e-7
    assert np.isfinite(inverse_root_single(np.float32(0.0)))


def test_constants_of_laws_are_rounded():
    scene = Scene(law="spring_dashpot")
    numbers = scene.contact_law.numbers(scene)
    values = [numbers.shear, *numbers.rolling, *numbers.damping]
    small = [to_single(numbers.shear), *to_single(numbers.rolling), *to_single(numbers.damping)]
    assert {type(value) for value in small} == {np.float32}
    assert np.allclose(values, small, rtol=1e-7)
    assert to_single(None) is None and dataclasses.is_dataclass(to_single(scene))
