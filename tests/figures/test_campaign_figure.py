"""The overview of a campaign: one column of panels per loading path, with the recorded curves."""

import numpy as np
import pytest

from labkit.engines import Device
from labkit.grains.scene import Scene
from labkit.paths.standard import ConstantMeanStress, ConstantVolume
from labkit.plugins.campaigns.figure import overview
from labkit.plugins.campaigns.jobs import Job
from labkit.results.dataset import open_run

pytestmark = pytest.mark.slow


def run_of(name, specimen, path, engine="fused"):
    return Job(name=name, specimen=specimen, path=path, device=Device(engine), scene=Scene())


def test_the_overview_has_a_column_per_path_and_a_line_per_run(run_file):
    runs = [
        (run_of("one", "a", ConstantVolume(), "yade"), run_file),
        (run_of("two", "b", ConstantVolume()), run_file),
        (run_of("three", "a", ConstantMeanStress(), "yade"), run_file),
    ]
    figure = overview(runs)
    ratio, other_ratio, void_ratio, _ = figure.axes
    assert [ratio.get_title(), other_ratio.get_title()] == ["cv", "cp"] and len(ratio.lines) == 2
    run = open_run(run_file)
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    above = p > 50e3
    np.testing.assert_allclose(ratio.lines[0].get_ydata()[above], (q / p)[above])
    assert np.isnan(ratio.lines[0].get_ydata()[~above]).all()
    np.testing.assert_array_equal(void_ratio.lines[1].get_ydata(), run["void_ratio"].values)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["a", "b", "yade", "fused"]


def test_pressures_of_one_path_on_one_specimen_have_colours_of_their_own(run_file):
    runs = [run_of(f"cp{p}", "a", ConstantMeanStress(pressure=p)) for p in (1e5, 2e5)]
    figure = overview([(run, run_file) for run in runs])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a, 100 kPa", "a, 200 kPa"]
    first, second = figure.axes[0].lines
    assert first.get_color() != second.get_color()
