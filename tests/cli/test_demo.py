"""`labkit demo` on real engines, with an existing specimen."""

import shutil

import pandas
import pytest

from labkit.cli import demo, main

pytestmark = [pytest.mark.slow, pytest.mark.yade]


def test_the_demo_compares_the_engines(specimen_file, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo, "STRAIN", 4e-3)
    monkeypatch.setattr(demo, "YADE_STRAIN", 2e-3)
    monkeypatch.setattr(demo, "COMPARED", (2e-3,))
    folder = tmp_path / "my demo"
    folder.mkdir()
    shutil.copyfile(specimen_file, folder / "demo.state.nc")
    assert main(["demo", "-o", str(folder)]) == 0
    table = pandas.read_csv(folder / "demo.engines.csv", index_col="quantity", comment="#")
    assert abs(table.loc["q/p at 0.2 %", "difference (%)"]) < 1e-6  # rounding: chaos needs more strain
    said = capsys.readouterr().out
    assert "Ctrl-C skips it" in said and "time steps per second: " in said
