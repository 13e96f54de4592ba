"""Steps of the Incremental Driver: each keyword against hand-worked cases, in labkit's axes, signs and units."""

import numpy as np
import pytest
import scipy.linalg

from labkit.errors import InputError
from labkit.micro.tensors import to_tensor
from labkit.paths.control import Control
from labkit.plugins.incremental.conventions import components, tensor
from labkit.plugins.incremental.driver_file import read_test

SIX_STRAINS = "0 0\n" * 6


def read(tmp_path, text, unit="kPa"):
    file = tmp_path / "test.inp"
    file.write_text(text if text.startswith("out") else f"out.out\n{text}")
    return read_test(file, unit)


def step_of(tmp_path, text, unit="kPa"):
    (step,) = read(tmp_path, text, unit).steps
    return step


def measures(step):
    """The tensors M_i, and the changes of M_i : sigma, Pa."""
    return to_tensor(step.measure), step.targets(np.zeros(len(step.measure)))[-1]


def response(step, stiffness=100e6, ratio=0.3):
    """(strain, stress) increments of an isotropic elastic body, as a solver would find them for the conditions."""
    identity = np.eye(3)
    lame, shear = stiffness * ratio / ((1 + ratio) * (1 - 2 * ratio)), stiffness / (2 * (1 + ratio))

    def stress(strain):
        return lame * np.trace(strain) * identity + 2 * shear * strain

    given = step.strains.sum(axis=0)
    given = 0.5 * (given + given.T)
    M, change = measures(step)
    free = np.reshape(step.free, (-1, 6))[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    matrix = np.array([[np.sum(m * stress(p)) for p in free] for m in M]).reshape(len(M), len(free))
    x = np.linalg.solve(matrix, change - [np.sum(m * stress(given)) for m in M]) if len(M) else []
    strain = given + sum((a * p for a, p in zip(x, free, strict=True)), np.zeros((3, 3)))
    return components(strain, shear=0.5), components(stress(strain)) / 1e3  # in the driver's order and sign, kPa


# --- conventions --------------------------------------------------------------------------------------------------


def test_axis_1_is_z_and_compression_is_negative():
    stress = tensor(np.array([-300.0, -100.0, -200.0, 12.0, 13.0, 23.0]))
    np.testing.assert_array_equal(stress, [[100.0, -23.0, -12.0], [-23.0, 200.0, -13.0], [-12.0, -13.0, 300.0]])
    strain = np.arange(6.0)
    np.testing.assert_allclose(components(tensor(strain, shear=0.5), shear=0.5), strain)
    assert tensor(np.array([0, 0, 0, 0.02, 0, 0]), shear=0.5)[0, 2] == -0.01  # gamma_12, of the axes z and x


# --- each keyword ---------------------------------------------------------------------------------------------------


def test_oedometric_steps(tmp_path):
    strain, stress = response(step_of(tmp_path, "*OedometricE1\n100 10 1.0\n-0.002 # comment\n"))
    np.testing.assert_allclose(strain, [-0.002, 0, 0, 0, 0, 0], atol=1e-15)
    assert stress[1] == pytest.approx(stress[0] * 0.3 / 0.7)  # K0 of an elastic body
    strain, stress = response(step_of(tmp_path, "*OedometricS1\n100 10 1.0\n-2.0D+2\n"))
    assert stress[0] == pytest.approx(-200.0) and np.abs(strain[1:]).max() < 1e-12 and strain[0] < 0.0


def test_triaxial_steps(tmp_path):
    strain, stress = response(step_of(tmp_path, "*TriaxialE1\n100 10 1.0\n-0.002\n"))
    np.testing.assert_allclose(stress, [-200.0, 0, 0, 0, 0, 0], atol=1e-9)  # E = 100 MPa
    assert strain[0] == pytest.approx(-0.002) and strain[1] == pytest.approx(0.0006)
    strain, stress = response(step_of(tmp_path, "*TriaxialS1\n100 10 1.0\n-0.2\n", "MPa"))
    np.testing.assert_allclose(stress, [-200.0, 0, 0, 0, 0, 0], atol=1e-9)


def test_undrained_triaxial_steps(tmp_path):
    step = step_of(tmp_path, "*TriaxialUEq\n100 30 100 : 10\n0.3\n")
    np.testing.assert_allclose(step.strains[0], np.diag([-0.15, -0.15, 0.3]))
    assert not step.measured and step.records == 10 and step.durations == (100.0,)
    strain, stress = response(step_of(tmp_path, "*TriaxialUq\n500 50 1.0\n100\n"))
    q = -(stress[0] - 0.5 * (stress[1] + stress[2]))
    assert q == pytest.approx(100.0) and abs(strain[:3].sum()) < 1e-15 and strain[0] < 0.0


def test_the_cartesian_form_of_a_triaxial_step_is_the_same(tmp_path):
    rows = "0 -0.15\n1 0\n1 0\n0 0\n0 0\n0 0\n"
    long = step_of(tmp_path, f"*LinearLoad \n1000 30 1\n*Cartesian\n{rows}")
    short = step_of(tmp_path, "*TriaxialE1\n1000 30 1\n-0.15\n")
    assert (long.strain, long.free, long.measured, long.stress) == (
        short.strain,
        short.free,
        short.measured,
        short.stress,
    )


@pytest.mark.parametrize(
    ("system", "matrix"),
    [
        ("*Roscoe", [[-1 / 3] * 3, [-1, 1 / 2, 1 / 2], [0, -1, 1]]),
        ("*RoscoeIsomorph", [[-(3**-0.5)] * 3, [-2 * 6**-0.5, 6**-0.5, 6**-0.5], [0, -(2**-0.5), 2**-0.5]]),
        ("*Rendulic", [[-1, 0, 0], [0, -(2**-0.5), -(2**-0.5)], [0, -(2**-0.5), 2**-0.5]]),
        ("*CARTESIAN", np.eye(3)),
    ],
)
def test_transformed_variables(tmp_path, system, matrix):
    """The matrices of the manual (Eqs. 22, 26): t = M T and e = M^-T eps, for stresses and for strains."""
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = matrix, np.eye(3)
    load = np.array([10.0, 20.0, -5.0, 3.0, 2.0, 1.0])
    rows = "\n".join(f"1, {value}" for value in load)
    _, stress = response(step_of(tmp_path, f"*LinearLoad\n10 5 1\n{system}\n{rows}\n"))
    np.testing.assert_allclose(M @ stress, load, atol=1e-9)
    rows = "\n".join(f"0 {1e-4 * value}" for value in load)
    strain, _ = response(step_of(tmp_path, f"*LinearLoad\n10 5 1\n{system}\n{rows}\n"))
    np.testing.assert_allclose(np.linalg.inv(M).T @ strain, 1e-4 * load, atol=1e-15)
    rows = "\n".join(f"{k % 2} {value * (1 if k % 2 else 1e-4)}" for k, value in enumerate(load))
    strain, stress = response(step_of(tmp_path, f"*LinearLoad\n10 5 1\n{system}\n{rows}\n"))
    mixed = np.where([False, True] * 3, M @ stress, np.linalg.inv(M).T @ strain * 1e4)
    np.testing.assert_allclose(mixed, load, atol=1e-8)


def test_roscoes_undrained_step_is_triaxial_ueq(tmp_path):
    rows = SIX_STRAINS.replace("0 0\n0 0\n", "0 0\n0 0.3\n", 1)
    assert (
        step_of(tmp_path, f"*LinearLoad\n9 9 1\n*Roscoe\n{rows}").strain
        == step_of(tmp_path, "*TriaxialUEq\n9 9 1\n0.3\n").strain
    )


def test_steps_that_hold(tmp_path):
    test = read(tmp_path, "*PureRelaxation\n10 5 60\n*PureCreep\n10 5 60\n*UndrainedCreep\n10 5 60\n")
    assert [len(step.measure) for step in test.steps] == [0, 6, 5]
    assert not any(any(step.strain) or any(step.stress) for step in test.steps) and len(test.notes) == 3
    assert "nothing creeps" in test.notes[1] and "*PureCreep, line 4" in test.notes[1]
    assert np.trace(to_tensor(test.steps[2].measure), axis1=1, axis2=2) == pytest.approx(0.0)  # eps_v stays


def test_a_circulating_load_is_a_sine_and_a_line(tmp_path):
    rows = "1 10 0 0\n" + "0 0.01 1.5707963267948966 0.02\n" + "0 0 0 0\n" * 4
    step = step_of(tmp_path, f"*CirculatingLoad\n40 10 2.0\n*Roscoe\n{rows}")
    share = np.linspace(0, 1, 41)
    np.testing.assert_allclose(step.targets(np.zeros(1))[:, 0], 1e4 * np.sin(2 * np.pi * share), atol=1e-9)
    q_strain = np.concatenate([[0.0], np.cumsum(step.strains[:, 2, 2])])
    np.testing.assert_allclose(q_strain, 0.01 * (np.cos(2 * np.pi * share) - 1) + 0.02 * share, atol=1e-15)
    assert sum(step.durations) == pytest.approx(2.0)


def test_a_deformation_gradient_is_reached_exactly(tmp_path):
    """Simple shear in the plane of axes 1 and 2 with axial compression; F in the driver's order of components."""
    F = np.array([[0.9, 0.3, 0.0], [0.0, 1.05, 0.0], [0.1, 0.0, 1.0]])
    values = [F[0, 0], F[1, 1], F[2, 2], F[0, 1], F[1, 0], F[0, 2], F[2, 0], F[1, 2], F[2, 1]]
    step = step_of(tmp_path, "*DeformationGradient\n100 1 1\n" + "\n".join(map(str, values)))
    total = np.eye(3)
    for piece in step.strains:
        total = scipy.linalg.expm(-piece) @ total
    axes = [1, 2, 0]  # indices of labkit's x, y, z in the driver's axes, which are z, x, y
    np.testing.assert_allclose(total, F[np.ix_(axes, axes)], atol=1e-12)
    with pytest.raises(InputError, match="not a possible deformation"):
        step_of(tmp_path, "*DeformationGradient\n100 1 1\n-1\n1\n1\n" + "0\n" * 6)


def test_restrictions_of_the_manual(tmp_path):
    """The isobaric biaxial test: constant mean stress, eps_1 = -0.01, plane strain."""
    rows = "sd1 + 1.0 *sd2 + sd3 = 0 # isobaric\ned1 = -0.01\ned3 = 0.0\ned4=0\ned5 = 0.0d0\ned6 = -0 ! plane\n"
    strain, stress = response(step_of(tmp_path, f"*ObeyRestrictions\n100 20 1.0\n{rows}"))
    assert abs(stress[:3].sum()) < 1e-9 and strain == pytest.approx([-0.01, 0.01, 0, 0, 0, 0])


def test_restrictions_of_any_direction(tmp_path):
    rows = "-sd1 + sd2 + 3.0*sd3 = -10\n2*ed1 - ed2 + 0.5*ed4 = 1.0d-3\ned3=0\ned5=0\nsd4=2\nsd6 = -3\n"
    step = step_of(tmp_path, f"*ObeyRestrictions\n100 20 1.0\n{rows}")
    strain, stress = response(step)
    found = [-stress[0] + stress[1] + 3 * stress[2], 1e3 * (2 * strain[0] - strain[1] + 0.5 * strain[3]), strain[2]]
    np.testing.assert_allclose([*found, strain[4], stress[3], stress[5]], [-10, 1, 0, 0, 2, -3], atol=1e-9)
    assert isinstance(step.control(np.zeros(3)), Control)


def test_an_imported_path(tmp_path):
    (tmp_path / "follow.inp").write_text("eps [%]  sigma\n text\n0 1.0 100 0\n 0.5 1.1 150 10\n1.0 1.3 130 30\n\n")
    rows = "0 1 * -0.01\n1 3 * -1\n1, 3 * -1.0d0\n0 0\n0 0\n0 0\n"
    step = step_of(tmp_path, f"*ImportFile follow.inp | 4 ? s1 < -5\n100 10 -1 : 1\n*Cartesian\n{rows}4 * 60\n")
    np.testing.assert_allclose(step.strains[:, 2, 2], [0.005, 0.005])
    np.testing.assert_allclose(step.targets(np.zeros(2))[:, 0], [0, 50e3, 30e3])
    assert step.durations == (600.0, 1200.0) and step.records == 2 and step.until is not None
    step = step_of(tmp_path, f"*ImportFile follow.inp|4\n1 10 2.5\n*Cartesian\n{rows}")
    assert step.rows == 1 and step.durations == (2.5,)


def test_repetition_and_the_end(tmp_path):
    cyclic = "*TriaxialUq\n500  50  1.0  \n100\n*Repetition\n2 10\n*TriaxialUq\n500  50  1.0  \n-200\n"
    test = read(tmp_path, cyclic + "*TriaxialUq\n500 50 1.0\n200\n*End\n*Nonsense\n")
    assert test.order == (0, *(1, 2) * 10) and [step.stress[0] for step in test.steps] == [100e3, -200e3, 200e3]
    assert read(tmp_path, "*TriaxialE1\n5 5 1\n-0.1\n*END\n*TriaxialE1\n5 5 1\n-0.1\n").order == (0,)
    assert read(tmp_path, "out.out # a heading\n*TriaxialE1\n5 5 1\n-0.1").heading == "a heading"
    assert read(tmp_path, "out.out\n\n! comment\n*triaxiale1\n5,5,1 T 0\n-0.1 strain").path().order == (0,)
