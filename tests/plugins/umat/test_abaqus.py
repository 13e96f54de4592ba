"""UMAT and SDVINI called as Abaqus calls them: signs, order of components, rotation, cuts, start."""

import ctypes
import dataclasses

import numpy as np
import pytest

from labkit.micro.tensors import to_six, to_tensor
from labkit.model.parameters import MEASURED
from labkit.model.state import ModelState, isotropic_state
from labkit.plugins.umat.material_point import update
from labkit.plugins.umat.props import PointStart, properties
from tests.model.random_states import random_state, rotation, symmetric
from tests.plugins.umat.points import largest_difference, random_walks

INDEX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # 11, 22, 33, 12, 13, 23


def components(tensor):
    """The six components in Abaqus's order."""
    return np.array([tensor[i, j] for i, j in INDEX])


def tensor_of(six):
    """A tensor from its six components in Abaqus's order."""
    tensor = np.empty((3, 3))
    for value, (i, j) in zip(six, INDEX, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return tensor


def statev_of(state):
    """STATEV of a ModelState."""
    return np.concatenate([[state.e, state.Z, state.Lam], *(components(T) for T in (state.A, state.F, state.Ft))])


def engineering(strain, n=6):
    """Engineering strains, tension positive, of a strain tensor with compression positive."""
    return -(components(strain) * [1, 1, 1, 2, 2, 2])[:n]


@pytest.fixture
def umat(shared_library, model):
    """A function that calls UMAT as Abaqus does, and returns (stress, statev, ddsdde, pnewdt)."""
    library = ctypes.CDLL(str(shared_library))

    def call(statev, dstran, stress=None, props=None, drot=None):
        n = len(dstran)
        stress, statev = np.zeros(n) if stress is None else stress.copy(), statev.copy()
        props = np.array(list(properties(model).values())) if props is None else props
        ddsdde, pnewdt = np.zeros((n, n)), np.ones(1)
        numbers = {name: ctypes.c_int(value) for name, value in (("ndi", 3), ("nshr", n - 3), ("ntens", n))}
        counts = [ctypes.byref(number) for number in numbers.values()]
        nstatv, nprops, one = ctypes.c_int(len(statev)), ctypes.c_int(len(props)), ctypes.c_int(1)
        unused, rotation = np.zeros(9), np.eye(3) if drot is None else drot

        def at(array):
            return np.asarray(array).ctypes.data_as(ctypes.c_void_p)

        turn = np.asfortranarray(rotation)
        arguments = [at(stress), at(statev), at(ddsdde), *[at(unused)] * 8, at(dstran), *[at(unused)] * 6]
        arguments += [ctypes.c_char_p(b"LABKIT".ljust(80)), *counts, ctypes.byref(nstatv), at(props)]
        arguments += [ctypes.byref(nprops), at(unused), at(turn), at(pnewdt), *[at(unused)] * 3]
        library.umat_(*arguments, *[ctypes.byref(one)] * 6, ctypes.c_size_t(80))
        return stress, statev, ddsdde.T, pnewdt[0]

    return call


@pytest.mark.parametrize("n", [6, 4])
def test_signs_order_and_shear_strains(model, umat, n):
    """n = 4: plane strain; the state has no shear out of the plane."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        state, strain = random_state(rng), symmetric(rng, 1e-4)
        if n == 4:
            strain[2, :2] = strain[:2, 2] = 0.0
            strain[2, 2] = 0.0
            state = ModelState(state.e, state.Z, state.Lam, *(_in_plane(T) for T in (state.A, state.F, state.Ft)))
        expected = update(model, state.vector()[None, :21], to_six(strain)[None]).require()
        stress, statev, tangent, pnewdt = umat(statev_of(state), engineering(strain, n))
        sigma = to_tensor(expected.stress[0])
        np.testing.assert_allclose(stress, -components(sigma)[:n], rtol=1e-9, atol=1e-9 * np.abs(sigma).max())
        after = ModelState.from_vector(np.append(expected.state[0], np.zeros(6)))
        np.testing.assert_allclose(statev, statev_of(after), rtol=1e-9, atol=1e-13)
        assert pnewdt == 1.0
        for k in range(n):  # a column: the stress change of a unit engineering strain
            unit = tensor_of(np.eye(6)[k] * [1, 1, 1, 0.5, 0.5, 0.5])
            column = to_tensor(expected.tangent[0] @ to_six(unit))
            np.testing.assert_allclose(tangent[:, k], components(column)[:n], atol=1e-9 * np.abs(tangent).max())


def test_random_walks_with_a_dependence_on_the_lode_angle(model, umat):
    model = dataclasses.replace(model, lode=MEASURED)
    props, weight = np.array(list(properties(model).values())), np.sqrt([1, 1, 1, 2, 2, 2])
    order = np.array([0, 1, 2, 5, 4, 3])  # indices of Abaqus's components in labkit's Mandel order

    def one(y, increment):
        state = np.concatenate([y[:3], *((y[k : k + 6] / weight)[order] for k in (3, 9, 15))])
        stress, state, tangent, pnewdt = umat(state, -(increment * weight)[order], props=props)
        assert pnewdt == 1.0
        after = np.concatenate([state[:3], *(state[k : k + 6][order] * weight for k in (3, 9, 15))])
        return after, -stress[order] * weight, tangent[np.ix_(order, order)] * np.outer(weight, weight)

    assert largest_difference(model, *random_walks(model), one) < 1e-8


def _in_plane(tensor):
    tensor = tensor.copy()
    tensor[2, :2] = tensor[:2, 2] = 0.0
    return tensor


def test_drot_rotates_the_tensors_of_the_state(umat):
    rng = np.random.default_rng(2)
    state, strain, Q = random_state(rng), symmetric(rng, 1e-4), rotation(rng)
    plain, *_ = umat(statev_of(state), engineering(strain))
    turned, *_ = umat(statev_of(state), engineering(Q @ strain @ Q.T), drot=Q)
    expected = Q @ tensor_of(plain) @ Q.T
    np.testing.assert_allclose(tensor_of(turned), expected, atol=1e-7 * np.abs(expected).max())


def test_an_increment_that_fails_is_cut_and_leaves_stress_and_state(model, umat):
    state = isotropic_state(model, 0.67, 0.5e6)
    before = components(-state.stress(model))
    opening = engineering(-0.05 * np.eye(3))
    stress, statev, tangent, pnewdt = umat(statev_of(state), opening, before)
    assert pnewdt == 0.25
    np.testing.assert_array_equal(stress, before)
    np.testing.assert_array_equal(statev, statev_of(state))
    assert np.isfinite(tangent).all() and np.all(np.diag(tangent) > 0.0)
    while pnewdt < 1.0:  # as a program does: some part of the increment succeeds
        opening *= pnewdt
        stress, *_, pnewdt = umat(statev_of(state), opening, before)
    assert -before[0] > -stress[0] > 0.0


def test_dilation_beyond_e_cmax_is_cut_or_continues_with_flat_lines(model, umat):
    state = ModelState(0.7599, 4.1, 1e-4)
    dilation = engineering(np.diag([-2e-4, -2e-4, 1e-4]))  # to e = 0.7604, beyond e_cmax = 0.76
    _, statev, tangent, pnewdt = umat(statev_of(state), dilation)
    assert pnewdt == 0.25 and np.isfinite(tangent).all()
    np.testing.assert_array_equal(statev, statev_of(state))
    flat = np.array(list(properties(model.reading(beyond_e_cmax="flat")).values()))
    stress, statev, tangent, pnewdt = umat(statev_of(state), dilation, props=flat)
    assert pnewdt == 1.0 and statev[0] == pytest.approx(0.7599 + 1.7599 * 3e-4, rel=1e-6)
    assert np.isfinite(stress).all() and np.isfinite(tangent).all() and stress[2] < 0.0


def test_points_start_from_the_stress_or_from_props(model, umat):
    """SDVINI leaves zeros, and the first call makes the state."""
    props = np.array(list(properties(model, PointStart(0.67, 0.2e6)).values()))
    geostatic = -np.array([5e4, 5e4, 1e5, 1e3, 0.0, 0.0])
    stress, statev, _, pnewdt = umat(np.zeros(21), np.zeros(6), geostatic, props)
    np.testing.assert_allclose(stress, geostatic, atol=1e-6)
    assert pnewdt == 1.0 and statev[0] == 0.67
    stress, *_ = umat(np.zeros(21), np.zeros(6), np.zeros(6), props)
    np.testing.assert_allclose(stress, [-0.2e6] * 3 + [0.0] * 3, rtol=1e-12)


@pytest.mark.parametrize("wrong", ["no start", "few props", "few statev", "plane stress", "negative"])
def test_wrong_input_is_cut_and_said(model, umat, capfd, wrong):
    props, statev, n = np.array(list(properties(model).values())), statev_of(isotropic_state(model, 0.67, 1e5)), 6
    if wrong == "no start":
        statev = np.zeros(21)
    elif wrong == "few props":
        props = props[:22]
    elif wrong == "few statev":
        statev = statev[:20]
    elif wrong == "plane stress":
        n = 3
    else:
        props = props.copy()
        props[7] = -1.0
    stress, _, tangent, pnewdt = umat(statev, np.zeros(n), None, props)
    assert pnewdt == 0.25 and np.isfinite(stress).all() and np.isfinite(tangent).all()


def test_only_the_first_23_props_are_needed(model, umat):
    state, props = isotropic_state(model, 0.67, 1e5), np.array(list(properties(model).values()))
    strain = engineering(np.diag([1e-4, 0.0, 0.0]))
    for found, expected in zip(
        umat(statev_of(state), strain, None, props[:23]), umat(statev_of(state), strain), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
