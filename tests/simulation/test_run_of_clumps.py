"""What is said of a run of clumps: numbers, widths and volumes are those of clumps, not of their spheres."""

import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.figures.grading_figure import grading, grading_table
from labkit.figures.micro_figures import groups
from labkit.figures.sff_figures import budget
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.micro.bodies import stress_along_normals
from labkit.micro.cells import widths
from labkit.micro.indicators import overlap_ratio
from labkit.micro.snapshot import contact_arms
from labkit.micro.stress import mean_stress
from labkit.plugins.pictures.picture import caption
from labkit.records.limits import width_warning
from labkit.results.verify import drift_share
from labkit.sff.budget import PARTS
from labkit.simulation.cost import announcement, cost_of_task
from labkit.simulation.tasks import SpecimenTask
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import draw_radii
from tests.bodies.clumped import clumped

pytestmark = pytest.mark.slow
SCENE = Scene(friction=0.5, rolling_friction=0.0)
RECIPE = Recipe(0.55, grains=120, shape="rod aspect_ratio=1.5")


@pytest.fixture(scope="module")
def rods():
    return lk.make_specimen(RECIPE, SCENE)


@pytest.fixture(scope="module")
def sheared(rods):
    path = lk.paths.ConstantMeanStress(pressure=3e5, strain=0.02, rate=100.0)
    return lk.run(rods, path, snapshots=4)


def spheres_and_rods(side=8.9e-4):
    """Spheres at random places, and the rods of equal volume that replace them."""
    rng = np.random.default_rng(1)
    radius = draw_radii(SCENE, side**3 / 1.55, rng)
    spheres = grains_in_cell(SCENE, radius, rng.random((len(radius), 3)) * side, np.eye(3) * side)
    return spheres, clumped(spheres, lk.Recipe(0.6, shape=RECIPE.shape).shapes)


def test_the_width_of_a_cell_is_that_of_spheres_of_equal_volume():
    spheres, rods = spheres_and_rods()
    of_spheres, of_rods = width_warning(spheres), width_warning(rods)
    assert of_rods.replace("clumps", "grains").replace(", taken as spheres of equal volume", "") == of_spheres
    width = 8.9e-4 / (2.0 * spheres.radius.max())
    assert f"give about {100 * int(np.ceil(len(spheres.radius) * (10.0 / width) ** 3 / 100)):,} grains" in of_spheres
    assert rods.contents == f"{len(spheres.radius)} clumps of {3 * len(spheres.radius)} spheres"
    assert spheres.contents == f"{len(spheres.radius)} grains"


def test_a_task_counts_clumps_and_costs_their_spheres():
    task = SpecimenTask(recipe=RECIPE, material=SCENE, device=Device("fused"), output=None)
    assert "about 120 clumps of 360 spheres" in announcement(task) and cost_of_task(task).grains == 360
    alone = SpecimenTask(recipe=Recipe(0.55, grains=120), material=SCENE, device=Device("fused"), output=None)
    assert "about 120 grains" in announcement(alone) and cost_of_task(alone).grains == 120


def test_overlaps_are_those_of_the_spheres_that_touch(rods):
    snapshot = rods.snapshot()
    assert overlap_ratio(snapshot) == overlap_ratio(snapshot.spheres) > 0.0
    assert "clumps" in caption(snapshot)


def test_the_grading_of_rods_is_that_of_the_scene(rods):
    table = grading_table(rods).set_index("diameter")
    np.testing.assert_allclose(table["grains, m"], table["grading, m"], rtol=0.04)
    labels = [text.get_text() for text in grading(rods).axes[0].get_legend().get_texts()]
    assert f"by mass, {rods.contents}" in labels


def test_a_correct_specimen_of_rods_has_the_volume_of_its_grading(sheared):
    lines = {line.name: line for line in lk.verify(sheared)}
    solid = lines["grains / (solid volume / mean grain volume)"]
    assert solid.holds and solid.value == pytest.approx(1.0, abs=0.03)
    run = sheared.data
    body = run.lab.body_radius
    least = lines["least width of the cell, in largest grains"].value
    assert least == pytest.approx(widths(run["cell"].values).min() / (2.0 * body.max()))
    assert 4.0 / 3.0 * np.pi * (body**3).sum() == pytest.approx(float(run["body_volume"].values.sum()))
    mass = SCENE.density * float(run["body_volume"].values.sum())
    drift = 0.5 * mass * (run["drift_velocity"].values ** 2).sum(axis=1)
    np.testing.assert_allclose(drift_share(run) * run["kinetic_energy"].values, drift, atol=1e-30)


def test_c0_needs_the_eccentric_contacts_of_rods(sheared):
    """Without M and X, and with the length of the contact vectors in Lambda, p of C0 is too high."""
    run = sheared.data
    love = run.lab.love_stress().values
    along = [mean_stress(stress_along_normals(one)) for one in sheared.snapshots]
    X = run["tangential_force_eccentricity"].values[run["record"].values]
    lengths = [
        np.linalg.norm(one.contacts.vectors, axis=2).sum() / contact_arms(one).sum() for one in sheared.snapshots
    ]
    assert min(lengths) > 1.02
    np.testing.assert_allclose(along / mean_stress(love) - 1.0, np.trace(X, axis1=1, axis2=2), atol=3e-3)
    error = run.lab.sff_errors()["p"].values[1:]
    assert np.abs(error).max() < 0.03
    _, table = budget(run)
    assert list(table["part"].unique()) == list(PARTS)


def test_size_groups_of_rods_add_up_to_the_stress(sheared):
    run = sheared.data
    found = run.lab.size_groups(3)
    assert (found["grains"].sum("group") == run.lab.number_of_grains).all()
    whole = (found["by_contacts"] * found["per_contact"]).sum("group")
    np.testing.assert_allclose(whole, run.lab.love_stress(), rtol=1e-9, atol=1e-9 * 3e5)
    assert len(groups(run, 3)[1])
