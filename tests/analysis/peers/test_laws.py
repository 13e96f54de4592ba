"""Any constitutive law can follow any path: other authors' laws, from Python and the command line, and your own."""

import json
from typing import ClassVar

import numpy as np
import pytest

import analysis.peers.laws  # noqa: F401  # registers them
import labkit
from labkit.cli import main
from labkit.errors import InputError
from labkit.model import MODELS, RateLaw, drive, model_path
from labkit.model.rates import FINE
from labkit.model.tensors import trace

HYDROSTATIC = np.eye(3)


class Linear(RateLaw):
    """Linear isotropic elasticity."""

    name = "linear"
    parameters: ClassVar = {"G": (50e6, 0.0, 1e12), "K": (80e6, 0.0, 1e12)}

    @staticmethod
    def rates(y, D, compressing, c, out):
        out[0] = -(1.0 + y[0]) * trace(D)
        for i in range(6):
            mean = trace(D) / 3.0 if i < 3 else 0.0
            out[1 + i] = 2.0 * c.G * (D[i] - mean) + 3.0 * c.K * mean
        return FINE


@pytest.mark.slow
def test_a_law_of_ones_own_is_one_class():
    law = Linear(G=40e6)
    result = drive(law, model_path("oedometer", 1e5, strain=0.02), law.start(0.7, 1e5 * HYDROSTATIC)).require()
    stress = result.stress[-1] - result.stress[0]
    np.testing.assert_allclose(np.diag(stress), 0.02 * (80e6 + 40e6 * np.array([-2, -2, 4]) / 3), rtol=1e-9)
    cp = drive(law, model_path("cp", 1e5, strain=0.001), law.start(0.7, 1e5 * HYDROSTATIC)).require()
    np.testing.assert_allclose([cp.q[-1], cp.p[-1]], [3 * 40e6 * 0.001, 1e5], rtol=1e-6)
    with pytest.raises(InputError, match="coordination_number"):
        _ = cp.Z


@pytest.mark.slow
@pytest.mark.parametrize("name", ["norsand"])
def test_a_peer_from_the_command_line(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    start = ["--void-ratio", "0.75", "--pressure", "500kPa", "--strain", "0.02"]
    assert main(["model", "cp", "--model", name, *start, "-o", "r.run.nc"]) == 0
    run = labkit.open_run("r.run.nc")
    assert json.loads(run.attrs["model"])["law"] == name and run.attrs["complete"] == 1
    assert float(run.lab.q()[-1]) > 0.2 * float(run.lab.mean_stress()[-1])
    assert main(["model", "cp", "--model", name, *start, "--coordination-number", "5"]) == 2
    assert "leave it out" in capsys.readouterr().err


def test_parameters_are_checked():
    kind = MODELS["hypoplasticity"]
    with pytest.raises(InputError, match="phi_c"):
        kind(phi_c=90.0)
    with pytest.raises(InputError, match=r"^phi "):
        kind(phi=30.0)
    with pytest.raises(InputError, match="is not an internal variable"):
        kind().start(0.7, 1e5 * HYDROSTATIC, delta=0.0)
