"""Selections of the records of a run: snapshots keep their own records, or the selection is refused."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.figures.frame import strain_axis
from labkit.paths.variables import increments

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=["first", "continued", "file"])
def run(request, soft_specimen, tmp_path_factory):
    """An undrained test with six snapshots in 16 records, in memory, continued from another, or from its file."""
    path = lk.paths.ConstantVolume(strain=0.015)
    options = {"progress": False, "snapshots": 6, "record_strain": 1e-3}
    start = soft_specimen
    if request.param == "continued":
        start = lk.run(start, lk.paths.ConstantVolume(strain=0.004), **options).state
    file = tmp_path_factory.mktemp("runs") / "r.run.nc" if request.param == "file" else None
    return lk.run(start, path, file=file, **options).data


def require_stress_of_contacts(part):
    """The stored stress at the snapshots is that of their contacts, and strains and figures belong to it."""
    love = [lk.love_stress(snapshot) for snapshot in part.lab.snapshots()]
    np.testing.assert_allclose(part.lab.at_snapshots("stress"), love, rtol=1e-9)
    assert len(love) == part.sizes["snapshot"] > 0
    strain = part["snapshot_strain"].values
    np.testing.assert_array_equal(part.lab.love_stress()["strain"], strain)
    np.testing.assert_allclose(strain_axis(part, at_snapshots=True)[1], 100 * strain)
    travelled = part.lab.contact_changes()["accumulated_strain"].values
    np.testing.assert_allclose(travelled, strain - part["axial_strain"].values[0], atol=1e-12)
    figure = lk.Run(part).plot("densities", snapshot=-1)
    assert f"{100 * strain[-1]:.1f} %" in figure.get_suptitle()


def test_snapshots_of_a_selection_have_their_own_records(run):
    records = run["record"].values
    require_stress_of_contacts(run)
    later = run.isel(time=slice(records[1], None), snapshot=slice(1, None))
    require_stress_of_contacts(later)
    np.testing.assert_array_equal(later.lab.snapshot_records(), records[1:] - records[1])
    even = np.flatnonzero(records % 2 == 0)
    require_stress_of_contacts(run.isel(time=slice(None, None, 2), snapshot=even))
    require_stress_of_contacts(run.isel(time=[records[3]], snapshot=[3]))
    require_stress_of_contacts(run.isel(time=slice(0, records[2] + 1), snapshot=slice(0, 3)))
    middle = run.sel(time=slice(run["time"].values[records[2]], run["time"].values[records[4]]))
    require_stress_of_contacts(middle.isel(snapshot=slice(2, 5)))
    backwards = run.isel(time=slice(None, None, -1))
    np.testing.assert_array_equal(backwards.lab.at_snapshots("stress"), run.lab.at_snapshots("stress"))


@pytest.mark.parametrize("number", [0, 5, -1])
@pytest.mark.parametrize("name", ["mean_stress", "q", "stress_ratio", "strain", "volumetric_strain", "friction_angle"])
def test_a_single_record_has_its_number(run, name, number):
    found = getattr(run.isel(time=number).lab, name)()
    assert found.shape == () and float(found) == float(getattr(run.lab, name)()[number])


def test_the_pore_pressure_of_a_single_record_starts_there_like_that_of_a_selection(run):
    single, selection = run.isel(time=5).lab, run.isel(time=[5]).lab
    assert single.is_undrained and selection.is_undrained
    assert float(single.pore_pressure_ratio()) == float(selection.pore_pressure_ratio()[0])


@pytest.mark.parametrize("time", [slice(3, None), slice(0, 3), slice(None, None, 2), [0], 0, []])
def test_a_selection_without_the_records_of_its_snapshots_is_refused(run, time):
    part = run.isel(time=time)
    asked = {
        "at_snapshots": lambda: part.lab.at_snapshots("stress"),
        "contact_lives": part.lab.contact_lives,
        "verify": lambda: lk.verify(part),
        **{name: lambda name=name: lk.Run(part).plot(name) for name in ("family", "budget", "groups", "contacts")},
    }
    if time in (0, []):  # accessor and figures need records
        asked = {"at_snapshots": asked["at_snapshots"]}
    for ask in asked.values():
        with pytest.raises(InputError, match=r"lacks those of snapshots .*run.isel\(time=..., snapshot=\["):
            ask()
    np.testing.assert_array_equal(part.lab.love_stress(), run.lab.love_stress())  # of the contacts alone


def test_steps_of_a_selection_have_the_snapshots_whose_records_they_have(soft_specimen):
    first = increments(strain={"zz": 0.005}, stress={"xx": 0.0, "yy": 0.0})
    path = lk.paths.Steps(pressure=1e5, steps=[first, increments(strain={"zz": 0.005})])
    run = lk.run(soft_specimen, path, progress=False, snapshots=8).data
    second = run.isel(time=slice(2, None)).lab.step(2)
    np.testing.assert_array_equal(second["snapshot_strain"], run.lab.step(2)["snapshot_strain"])
    require_stress_of_contacts(second)
