"""Packages of version 0.1 and their public names still work, with a warning that gives their new place."""

import importlib

import pytest

FORMER = {
    "dem": "Scene State Recipe Control ConstantVolume make_path read_state write_state Options Servo Schedule Layer "
    "LAWS PATHS QUANTITIES SETTINGS OVERLAP_LIMIT kinetic_energy exceeded quantity condition travelled Engine",
    "campaign": "read_campaign plan_of open_campaign Campaign",
    "visuals": "plots draw_grains Viewer save",
}


@pytest.mark.parametrize("package", FORMER)
def test_former_names_warn_and_are_those_of_the_new_room(package):
    module = importlib.import_module(f"labkit.{package}")
    for name in FORMER[package].split():
        with pytest.warns(FutureWarning, match=rf"labkit\.{package}\.{name} is now labkit\.\w+\.{name};") as warned:
            former = getattr(module, name)
        room = str(warned[0].message).split()[3].rpartition(".")[0]
        assert former is getattr(importlib.import_module(room), name)
    with pytest.raises(AttributeError, match=f"'labkit.{package}' .*'cv'"):
        module.cv  # noqa: B018
