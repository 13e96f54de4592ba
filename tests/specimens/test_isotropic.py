"""Isotropic specimens: all six stresses reach their targets with a free cell, and the fixed cell of the paper."""

import dataclasses
import json

import numpy as np
import pytest

import labkit as lk
from labkit.engines.device import Device
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress, largest_deviation, mean_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.paths.standard import Consolidation, Levelling
from labkit.plugins.campaigns.jobs import Job
from labkit.process.interruption import Signals
from labkit.servo.plan import BASIS, TRIANGULAR
from labkit.simulation.tasks import SpecimenTask
from labkit.specimens import consolidation
from labkit.specimens.consolidation import Interim, contact_stress, level_stress, stress_error
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import STEP2, insert_grains, prepare_specimen, relax

ISOTROPIC = 0.005  # largest q/p, with q the invariant
ENGINES = ["fused", "yade"]


def ratio(state):
    """Return q/p, with q the invariant."""
    stress = love_stress(state.snapshot())
    return float(equivalent_stress(stress) / mean_stress(stress))


def is_upper_triangular(cell):
    return not np.tril(cell, -1).any()


@pytest.fixture(scope="module", params=ENGINES)
def inserted(request):
    return lk.make_specimen(Recipe(0.67, grains=200), engine=request.param, progress=False)


def test_an_inserted_specimen_is_isotropic_at_exactly_its_void_ratio(inserted):
    assert ratio(inserted) < ISOTROPIC
    assert void_ratio_nominal(inserted.snapshot()) == pytest.approx(0.67, rel=1e-10)
    assert is_upper_triangular(inserted.cell) and np.triu(inserted.cell, 1).any()
    assert json.loads(inserted.recipe)["cell"] == "free"


@pytest.mark.parametrize("pressure", [100e3, 1e6])
def test_a_consolidated_specimen_is_isotropic(inserted, pressure):
    state = lk.consolidate(inserted, pressure, engine=inserted.engine, progress=False)
    assert largest_deviation(love_stress(state.snapshot()), pressure)[1] < 1.5e-3 * pressure
    assert ratio(state) < ISOTROPIC
    assert is_upper_triangular(state.cell)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("pressure", [None, "100 kPa"])
def test_a_compressed_specimen_is_isotropic(engine, pressure):
    recipe = Recipe(None if pressure else 0.67, grains=150, preparation="compression", pressure=pressure)
    state = lk.make_specimen(recipe, engine=engine, progress=False)
    assert ratio(state) < ISOTROPIC and is_upper_triangular(state.cell)
    if pressure is None:
        assert void_ratio_nominal(state.snapshot()) == pytest.approx(0.67, rel=1e-8)
    else:
        assert mean_stress(love_stress(state.snapshot())) == pytest.approx(100e3, rel=2e-3)


@pytest.mark.parametrize(
    "recipe, scene, precision",
    [
        (Recipe(0.67, grains=100), lk.Scene(), "double"),
        (Recipe(0.67, grains=200), lk.Scene(), "mixed"),
        (Recipe(0.8, 0.5, grains=300), lk.Scene(), "double"),
        (Recipe(0.67, grains=300, aspect=0.5, size_classes=1), lk.Scene(), "double"),
        (Recipe(0.55, grains=200), lk.Scene(friction=0.0, rolling_friction=0.0), "double"),
        (Recipe(0.5, 0.15, 0.0, grains=120, shape="rod aspect_ratio=1.5"), lk.Scene(rolling_friction=0.0), "double"),
        (Recipe(0.67, grains=150, seed=2), lk.Scene(law="dmt"), "double"),
    ],
    ids=["few", "mixed", "loose", "flat", "frictionless", "rods", "adhesive"],
)
def test_unusual_specimens_are_isotropic(recipe, scene, precision):
    state = lk.make_specimen(recipe, scene, progress=False, engine=lk.Fused(precision=precision))
    assert ratio(state) < ISOTROPIC
    assert void_ratio_nominal(state.snapshot()) == pytest.approx(recipe.void_ratio, rel=1e-8)


@pytest.fixture(scope="module")
def kept():
    """A specimen in a fixed cell."""
    return lk.make_specimen(Recipe(0.67, grains=200, cell="fixed"), progress=False)


def test_a_fixed_cell_keeps_its_shape_and_the_shear_stresses(kept):
    inserted = insert_grains(kept.scene, Recipe.from_json(kept.recipe))
    np.testing.assert_array_equal(kept.cell, inserted.cell)
    assert ratio(kept) > 0.02


def test_the_fixed_cell_is_the_way_of_the_paper_bit_by_bit(kept):
    recipe = Recipe.from_json(kept.recipe)
    soft = lk.Scene().with_friction(recipe.step1_friction, recipe.step1_rolling_friction)
    old = relax(insert_grains(soft, recipe), lk.Scene(), Device("fused"))
    for name in ("position", "cell", "tangential_force", "contact_grain"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(old, name))
    levelled = level_stress(old, STEP2.unbalanced_force, Device("fused"))
    free = prepare_specimen(lk.Scene(), dataclasses.replace(recipe, cell="free"), Device("fused"))
    np.testing.assert_array_equal(free.position, levelled.position)


def test_a_consolidation_does_as_the_specimen_was_made_unless_told_otherwise(kept):
    stay = lk.consolidate(kept, 300e3, progress=False)
    turned = lk.consolidate(kept, 300e3, progress=False, cell="free")
    assert not np.triu(stay.cell, 1).any() and ratio(stay) > 0.02
    np.testing.assert_allclose(np.diag(love_stress(stay.snapshot())), 300e3, rtol=1e-3)
    assert ratio(turned) < ISOTROPIC
    task = SpecimenTask(recipe=Recipe.from_json(kept.recipe), material=kept.scene)
    assert task.has_made(kept) and not task.has_made(stay) and not task.has_made(turned)
    with pytest.raises(InputError, match="cell 'loose' is unknown: give one of free, fixed"):
        lk.consolidate(kept, 300e3, progress=False, cell="loose")
    with pytest.raises(InputError, match="cell 'loose' is unknown: give one of free, fixed"):
        Recipe(0.67, cell="loose")


def test_a_run_consolidates_as_the_specimen_was_made(kept, inserted):
    path = lk.paths.ConstantMeanStress(pressure=200e3, strain=2e-3, rate=100.0)
    runs = [lk.run(state, path, progress=False, record_strain=1e-3) for state in (kept, inserted)]
    stays, turns = (run.snapshots[0].cell for run in runs)
    assert not np.triu(stays, 1).any() and is_upper_triangular(turns)
    for made, run in zip((kept, inserted), runs, strict=True):
        task = SpecimenTask(recipe=Recipe.from_json(made.recipe), material=made.scene, device=Device(made.engine))
        assert task.has_made(made) and not task.has_made(run.state.at_rest())
    started = [lk.love_stress(run.snapshots[0]) for run in runs]
    assert largest_deviation(started[1], 200e3)[1] < 0.005 * 200e3 < largest_deviation(started[0], 200e3)[1]


def test_a_recipe_from_before_means_a_fixed_cell():
    values = json.loads(Recipe(0.67).to_json())
    assert values.pop("cell") == "free"
    assert Recipe.from_json(json.dumps(values)) == Recipe(0.67, cell="fixed")
    assert Recipe.from_json("an imported packing") is None


@pytest.mark.parametrize("cell", ["free", "fixed"])
def test_a_job_tells_its_cell_and_one_from_before_means_a_fixed_cell(cell):
    made = Job(name="a", device=Device("fused"), scene=lk.Scene(), recipe=Recipe(0.67, cell=cell), cell=cell)
    brought = Job(name="b", device=Device("fused"), scene=lk.Scene(), source="a.state.nc", pressure=3e5, cell=cell)
    for job in (made, brought):
        values = json.loads(job.to_json())
        assert Job.from_values(values) == job
        stored = values["task"]["recipe"] if job is made else values["task"]
        assert stored.get("cell") == (None if cell == "fixed" else "free")  # so that old digests stay


def test_the_basis_with_spin_has_the_same_strain_rates_and_stays_above_the_diagonal():
    np.testing.assert_allclose(0.5 * (TRIANGULAR + TRIANGULAR.transpose(0, 2, 1)), BASIS, atol=1e-15)
    assert not np.tril(TRIANGULAR, -1).any()


def test_levelling_is_possible_and_isochoric():
    control = Levelling().control()
    control.require_possible()
    assert control.isochoric
    assert not Consolidation(pressure=1e5).control().isochoric


def test_errors_of_targets_of_zero_are_relative_to_the_mean_stress(kept):
    snapshot = kept.snapshot()
    stress = love_stress(snapshot)
    assert contact_stress(snapshot) == pytest.approx(mean_stress(stress), rel=1e-9)
    error = stress_error(snapshot, Levelling().control())
    assert ratio(kept) / np.sqrt(1.5 * 5) <= error <= ratio(kept) / np.sqrt(1.5)


def test_a_specimen_without_contacts_is_level(kept):
    gas = insert_grains(lk.Scene(), Recipe(1.0, grains=100)).replace(time_step=lk.Scene().time_step)
    assert level_stress(gas, 1e-4, Device("fused")) is gas


def test_what_does_not_become_isotropic_says_what_to_do(kept, monkeypatch):
    monkeypatch.setattr(consolidation, "STEP_LIMIT", 0)
    with pytest.raises(PhysicsError, match=r"did not become isotropic .* cell = fixed, which keeps the shear stresses"):
        level_stress(kept, 1e-4, Device("fused"))
    with pytest.raises(PhysicsError, match="closer to the current one, or cell = fixed"):
        lk.consolidate(kept, 1e6, progress=False, cell="free")


def test_what_does_not_come_to_rest_is_not_said_to_miss_its_stress(kept, monkeypatch):
    monkeypatch.setattr(consolidation, "REST_LIMIT", 5000)
    with pytest.raises(PhysicsError, match="reached its stresses, but did not come to rest"):
        level_stress(kept, 1e-30, Device("fused"))


def test_an_unguarded_run_consolidates_beyond_the_stability_limit(kept):
    fast = kept.replace(scene=kept.scene.replace(time_step_factor=0.42))
    path = lk.paths.ConstantMeanStress(pressure=300e3, strain=5e-3, rate=100.0)
    with pytest.raises(PhysicsError, match="exceeds the stability limit"):
        lk.run(fast, path, progress=False)
    assert lk.run(fast, path, progress=False, guarded=False, record_strain=1e-3).complete


def own_law(share):
    """Register a law whose spring is softer by a share."""

    class Spring(lk.laws.LinearSpring):
        @staticmethod
        def force(stiffness, overlap):
            return share * stiffness * overlap

        @staticmethod
        def energy(stiffness, overlap):
            return 0.5 * share * stiffness * overlap * overlap

    law = type("Own", (lk.ContactLaw,), {"name": "of_a_consolidation", "parts": Spring() + lk.laws.Coulomb()})
    return lk.register_law(law)


def test_an_interim_state_is_only_that_of_the_same_law_and_precision(kept, tmp_path):
    def interim(share, precision="double"):
        own_law(share)
        scene = lk.Scene(law="of_a_consolidation")
        state, path = kept.replace(scene=scene, columns={}), Consolidation(pressure=1e5)
        return Interim(tmp_path / "i", state, path, Device("fused", precision=precision)), state

    stopped = Signals()
    stopped.catch(15)
    first, state = interim(0.5)
    with pytest.raises(Interrupted):
        first.keep(state, stopped)
    assert interim(0.5)[0].resume() is not None
    assert interim(0.6)[0].resume() is None and interim(0.5, "mixed")[0].resume() is None


@pytest.mark.parametrize(
    "stress, farthest",
    [(np.diag([1.0, -3.0, 2.0]), ("yy", 3.0)), (-4.0 * np.eye(3)[[2, 1, 0]] * [1, 0, 1], ("xz", 4.0))],
)
def test_the_largest_deviation_from_an_isotropic_stress(stress, farthest):
    name, size = largest_deviation(100.0 * np.eye(3) + stress, 100.0)
    assert (name, size) == (farthest[0], pytest.approx(farthest[1]))
