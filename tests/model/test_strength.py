"""Sections of strength criteria in the deviatoric plane: the criteria hold at their own stresses."""

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.micro.stress import equivalent_stress, lode_angle, mean_stress
from labkit.model import Model, ModelState, drive, isotropic_state, model_path
from labkit.model.strength import (
    SECTIONS,
    critical_section,
    matsuoka_nakai,
    model_section,
    mohr_coulomb,
    principal_cosines,
)

ANGLE, M = np.linspace(0.0, 60.0, 13), 1.1
SINE = 3.0 * M / (6.0 + M)


def principal(section):
    """Principal stresses at p = 1 on a section, (13, 3)."""
    return 1.0 + 2.0 / 3.0 * section(M, ANGLE)[:, None] * principal_cosines(ANGLE)


def test_principal_stresses_have_the_q_and_the_lode_angle_of_the_section():
    tensors = np.array([np.diag(row) for row in principal(mohr_coulomb)])
    np.testing.assert_allclose(mean_stress(tensors), 1.0)
    np.testing.assert_allclose(equivalent_stress(tensors), mohr_coulomb(M, ANGLE))
    np.testing.assert_allclose(lode_angle(tensors), ANGLE, atol=1e-5)


def test_each_criterion_holds_on_its_section():
    s = principal(mohr_coulomb)
    np.testing.assert_allclose(s.max(axis=1) - s.min(axis=1), SINE * (s.max(axis=1) + s.min(axis=1)))
    s = principal(matsuoka_nakai)
    second = s[:, 0] * s[:, 1] + s[:, 1] * s[:, 2] + s[:, 2] * s[:, 0]
    np.testing.assert_allclose(s.sum(axis=1) * second / s.prod(axis=1), (9 - SINE**2) / (1 - SINE**2))


def test_both_criteria_agree_in_compression_and_extension_and_the_model_is_wider():
    for section in SECTIONS.values():
        assert section(M, np.array(0.0)) == pytest.approx(M)
    extension = 6.0 * SINE / (3.0 + SINE)
    assert mohr_coulomb(M, np.array(60.0)) == pytest.approx(extension)
    assert matsuoka_nakai(M, np.array(60.0)) == pytest.approx(extension)
    assert (matsuoka_nakai(M, ANGLE[1:-1]) > mohr_coulomb(M, ANGLE[1:-1])).all()
    assert (model_section(M, ANGLE[1:]) > matsuoka_nakai(M, ANGLE[1:])).all()


def test_the_section_of_the_model_is_where_its_tests_end():
    model = Model()
    start = isotropic_state(model, 0.67, 5e5)
    for strain, angle in ((0.8, 0.0), (-0.8, 60.0)):
        test = drive(model, model_path("cp", 5e5, strain=strain), start).require()
        ratio, reached = critical_section(np.array(angle), model)
        assert abs(test.q[-1]) / test.p[-1] == pytest.approx(float(ratio), rel=0.01)
        assert float(reached) == pytest.approx(angle, abs=1e-3) and isinstance(test.state(), ModelState)


@pytest.mark.parametrize("strength", [0.0, 3.0, -1.0])
def test_an_impossible_strength_is_refused(strength):
    with pytest.raises(InputError, match="strength"):
        mohr_coulomb(strength, ANGLE)
