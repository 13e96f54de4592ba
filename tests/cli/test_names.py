"""Default names of files stay the same, so that the same command finds its file again."""

import shlex

import pytest

from labkit.cli import main
from labkit.cli.dispatch import parse
from labkit.cli.outputs import consolidated_name, run_name
from labkit.model.parameters import Model
from labkit.paths.registry import PATHS
from tests.cli.options import run_options

SPECIMENS = {
    "--void-ratio 0.67": "e0.67_f0.15_r0.1_l0.004_s1",
    "--void-ratio 0.67 --grains 500": "e0.67_f0.15_r0.1_n500_s1",
    "--void-ratio 0.7 --side 2e-3 --seed 4": "e0.7_f0.15_r0.1_l0.002_s4",
    "--void-ratio 0.7 --side 2mm --seed 4": "e0.7_f0.15_r0.1_l0.002_s4",
    "--void-ratio 0.67 --settings quick": "e0.67_f0.15_r0.1_n2000_s1_t0.3",
    "--void-ratio 0.67 --settings standard": "e0.67_f0.15_r0.1_l0.004_s1",
    "--void-ratio 0.67 --settings reference": "e0.67_f0.15_r0.1_l0.004_s1_t0.1",
    "--void-ratio 0.67 --step1-friction 0.3 --step1-rolling-friction 0.05 --grains 1000": "e0.67_f0.3_r0.05_n1000_s1",
    "--void-ratio 0.67 --settings quick --grains 700 --time-step-factor 0.1": "e0.67_f0.15_r0.1_n700_s1_t0.1",
    "--void-ratio 0.67 --law rolling_resistance": "e0.67_f0.15_r0.1_l0.004_s1",
    "--void-ratio 0.67 --law spring_dashpot --engine fused": "e0.67_f0.15_r0.1_l0.004_s1_spring_dashpot",
    "--void-ratio 0.67 --friction 0.5 --rolling-friction 0": "e0.67_f0.15_r0.1_l0.004_s1_mu0.5_mur0",
    "--void-ratio 0.67 --young-modulus 300MPa --side 4mm": "e0.67_f0.15_r0.1_l0.004_s1_E3e+08",
    "--void-ratio 0.55 --grains 500 --shape 'rod aspect_ratio=1.5'": "e0.55_f0.15_r0.1_n500_s1_rod-aspect_ratio1.5",
    "--void-ratio 0.67 --grains 500 --size-classes 5": "e0.67_f0.15_r0.1_n500_s1_size_classes5",
    "--preparation compression --pressure 100kPa --grains 100 --fabric deposited": (
        "f0.15_r0.1_n100_s1_compression_p100kPa_deposited"
    ),
    "--preparation bisection --void-ratio 0.7 --pressure 100kPa --grains 100 --tolerance 0.01": (
        "e0.7_f0.15_r0.1_n100_s1_bisection_p100kPa_tolerance0.01"
    ),
}
RUNS = {
    "cv": "s_cv",
    "cp --pressure 0.5e6": "s_cp_p500kPa",
    "cr --pressure 500e3 --strain 0.05": "s_cr_p500kPa_e0.05",
    "cp --pressure 1.5e5 --rate 20 --strain 0.1": "s_cp_p150kPa_e0.1_r20",
    "cv --settings quick": "s_cv_quick",
    "cv --settings quick --rate 5 --time-step-factor 0.1": "s_cv_r5_quick_t0.1",
    "isoc --pressure 1.2e6": "s_isoc_p1200kPa",
    "isod --strain -0.05": "s_isod_e-0.05",
    "cyclic_cp --pressure 0.5e6 --reversals 0.01,-0.01,0.02": "s_cyclic_cp_p500kPa_c0.01_-0.01_0.02",
    "cyclic_cp --reversals=-0.01,0.01 --rate 5": "s_cyclic_cp_r5_c-0.01_0.01",
    "cv --record-strain 1e-4 --snapshots 3 --threads 2 --engine fused": "s_cv",
    "cp --pressure 0.5MPa --strain 10%": "s_cp_p500kPa_e0.1",
    "cv --law spring_dashpot --friction 0.30": "s_cv_mu0.3_spring_dashpot",
    "cv --from-snapshot=-2": "s_snapshot-2_cv",
}
MODELS = {
    "": "model_cv_void_ratio0.67_p500kPa_e0.01",
    "--parameters soft.json": "model_cv_void_ratio0.67_p500kPa_e0.01_soft",
    "--beyond-e-cmax flat": "model_cv_void_ratio0.67_p500kPa_e0.01_flat",
    "--stop-when 'q/p > 0.1'": "model_cv_void_ratio0.67_p500kPa_stop_when-ea9bbf_e0.01",
}


@pytest.mark.parametrize("words", SPECIMENS)
def test_names_of_specimens(words):
    assert parse(["specimen", *shlex.split(words)])[1]["task"].output == f"{SPECIMENS[words]}.state.nc"


@pytest.mark.parametrize("words", RUNS)
def test_names_of_runs_in_the_folders_of_their_specimens(words):
    path, *more = words.split()
    given = run_options([path, "some/s.state.nc", *more])
    snapshot = given["specimen"].snapshot
    texts = given["loading"], given["material"], given["working"][0]
    name = run_name(path, "some/s.state.nc", PATHS[path], *texts, snapshot)
    assert name == f"some/{RUNS[words]}.run.nc"


def test_names_of_consolidated_specimens():
    assert consolidated_name("some/s.state.nc", 0.5e6) == "some/s_p500kPa.state.nc"
    assert consolidated_name("some/s.run.nc", 0.5e6, snapshot=3) == "some/s_snapshot3_p500kPa.state.nc"


def test_names_of_model_runs(tmp_path, monkeypatch, capsys):
    """Each option that changes the result gives a file of its own, and the same command says what it replaces."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "soft.json").write_text(Model(young_modulus=1e8).to_json())
    start = "model cv --void-ratio 0.67 --pressure 500kPa --strain 0.01"
    for words, name in MODELS.items():
        assert main(shlex.split(f"{start} {words}")) == 0
        said = capsys.readouterr().out
        assert f"{name}.run.nc: cv complete" in said and "replaced" not in said
    assert main(shlex.split(start)) == 0 and "will be replaced" in capsys.readouterr().out
