import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.files.schema import STATE
from labkit.grains.state_file import read_state, write_state


def test_a_state_file_has_the_documented_names_units_and_attributes(specimen_file):
    with netCDF4.Dataset(specimen_file) as dataset:
        assert set(dataset.dimensions) == {"grain", "contact", "side", "i", "j", "letter"}
        names = (
            "radius position velocity angular_velocity cell velocity_gradient contact_grain contact_shift "
            "tangential_force rolling_moment i j"
        ).split()
        assert set(names) == set(dataset.variables)
        for variable in dataset.variables.values():
            assert variable.units and variable.long_name
        for name in "scene time time_step step seed engine engine_version labkit_version history".split():
            assert name in dataset.ncattrs()


def test_writing_and_reading_keeps_every_bit(specimen_file, tmp_path):
    state = read_state(specimen_file)
    write_state(tmp_path / "copy.state.nc", state)
    copy = read_state(tmp_path / "copy.state.nc")
    for name in STATE:
        np.testing.assert_array_equal(getattr(state, name), getattr(copy, name))
    assert (copy.scene, copy.time_step, copy.seed, copy.history) == (
        state.scene,
        state.time_step,
        state.seed,
        state.history,
    )


def test_a_state_without_contacts_can_be_saved(specimen_file, tmp_path):
    state = read_state(specimen_file)
    empty = {name: getattr(state, name)[:0] for name, v in STATE.items() if "contact" in v.dimensions}
    write_state(tmp_path / "empty.state.nc", state.replace(**empty))
    assert len(read_state(tmp_path / "empty.state.nc").contact_grain) == 0


def test_damaged_files_are_refused(specimen_file, tmp_path):
    whole = specimen_file.read_bytes()
    for length in (0, 100, len(whole) // 2, len(whole) - 1000):
        (tmp_path / "cut.state.nc").write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"cut\.state\.nc"):
            read_state(tmp_path / "cut.state.nc")
    with netCDF4.Dataset(tmp_path / "bare.state.nc", "w") as dataset:
        dataset.labkit_file = "state"
    with pytest.raises(InputError, match=r"bare\.state\.nc"):
        read_state(tmp_path / "bare.state.nc")


def test_a_state_equals_itself_and_a_digest_its_content(specimen_file):
    one, two = read_state(specimen_file), read_state(specimen_file)
    assert one in [two, one] and one != two and len({one, two}) == 2
    assert one.digest() == two.digest() != two.replace(position=two.position + 1e-9).digest()


def test_a_state_of_your_own_grains_is_a_specimen():
    """As `import_state` makes it: the scene has the sizes of the grains, and the contacts are those that touch."""
    specimen = lk.make_specimen(lk.Recipe(0.67, grains=100), progress=False)
    fields = specimen.radius.tolist(), specimen.position.tolist()
    state = lk.State.from_arrays(*fields, cell=np.diag(specimen.cell), scene=lk.Scene(friction=0.3))
    diameter = 2.0 * specimen.radius
    assert state.scene.friction == 0.3 and np.isclose(state.scene.mean_diameter, diameter.mean(), rtol=1e-14)
    assert np.isclose(state.scene.diameter_spread, np.sqrt(3.0) * diameter.std() / diameter.mean(), rtol=1e-12)
    assert state.cell.tolist() == np.diag(np.diag(specimen.cell)).tolist()
    loaded = lk.run(state, lk.paths.ConstantVolume(strain=1e-3), progress=False).state
    assert len(loaded.contact_grain) > 100
    for wrong in (fields[0][:-1], [-1e-4] * len(fields[0]), [1.0] * len(fields[0])):
        with pytest.raises(lk.InputError, match=r"radius|cell|position|diameter"):
            lk.run(lk.State.from_arrays(wrong, fields[1], cell=specimen.cell), lk.paths.ConstantVolume())
