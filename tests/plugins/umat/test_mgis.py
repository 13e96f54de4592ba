"""The behaviour for MGIS: the structures it passes, and MGIS itself where its Python bindings are installed."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

from labkit.micro.tensors import to_six
from labkit.model.parameters import Model
from labkit.model.state import isotropic_state
from labkit.plugins.umat import library
from labkit.plugins.umat.library import write
from labkit.plugins.umat.material_point import update
from labkit.plugins.umat.props import PointStart, properties
from tests.plugins.umat.house_paths import PATHS, TOLERANCE, assert_same_curve, curve
from tests.plugins.umat.points import largest_difference, random_increments, random_states, random_walks

pytestmark = pytest.mark.slow

ORDER = [0, 1, 2, 5, 4, 3]  # indices of TFEL's xx, yy, zz, sqrt2 xy, sqrt2 xz, sqrt2 yz in labkit's Mandel order
DOUBLES = ctypes.POINTER(ctypes.c_double)
FIELDS = "gradients forces density properties internal stored dissipated external".split()


class State(ctypes.Structure):
    """mgis_bv_StateView."""

    _fields_ = [(name, DOUBLES) for name in FIELDS]


class Data(ctypes.Structure):
    """mgis_bv_BehaviourDataView."""

    _fields_ = [
        ("error_message", ctypes.c_char_p),
        ("dt", ctypes.c_double),
        ("K", DOUBLES),
        ("rdt", DOUBLES),
        ("speed_of_sound", DOUBLES),
        ("s0", State),
        ("s1", State),
    ]


def tfel(y):
    """Internal state variables in TFEL's order from a state vector (21,)."""
    return np.concatenate([y[:3], *(y[k : k + 6][ORDER] for k in (3, 9, 15))])


@pytest.fixture
def behaviour(shared_library, model):
    """The behaviour with the constants of Table 2 (behaviour_of)."""
    return behaviour_of(shared_library, model)


def behaviour_of(file, model):
    """A function (isvs, strain increment, kind of operator, stress) -> (code, stress, isvs, K, rdt, message)."""
    compiled = ctypes.CDLL(str(file))
    function = compiled.labkit_Tridimensional
    props = np.array(list(properties(model, PointStart(0.67)).values()))
    assert ctypes.c_ushort.in_dll(compiled, "labkit_nMaterialProperties").value == len(props)

    def call(internal, strain, kind=4.0, stress=None):
        arrays = {name: [np.zeros(30), np.zeros(30)] for name in FIELDS}
        arrays["gradients"][1][:6] = strain
        arrays["internal"][0][:21] = internal
        arrays["properties"] = [props, props]
        arrays["forces"][0][:6] = 0.0 if stress is None else stress
        K, rdt, message = np.zeros(36), np.ones(1), ctypes.create_string_buffer(512)
        K[0] = kind
        views = [State(*(arrays[name][k].ctypes.data_as(DOUBLES) for name in FIELDS)) for k in (0, 1)]
        data = Data(
            ctypes.addressof(message), 1.0, K.ctypes.data_as(DOUBLES), rdt.ctypes.data_as(DOUBLES), None, *views
        )
        code = function(ctypes.byref(data))
        return code, arrays["forces"][1][:6], arrays["internal"][1][:21], K.reshape(6, 6), rdt[0], message.value

    return call


def test_behaviour_agrees_with_python(model, behaviour):
    rng = np.random.default_rng(1)
    states, increments = random_states(rng, 20), random_increments(rng, 20, 1e-4)
    expected = update(model, states, increments).require()
    for k in range(20):
        code, stress, internal, K, rdt, _ = behaviour(tfel(states[k]), -increments[k][ORDER])
        assert code == 1 and rdt == 1.0
        size = np.abs(expected.stress[k]).max()
        np.testing.assert_allclose(stress, -expected.stress[k][ORDER], atol=1e-9 * size)
        np.testing.assert_allclose(internal, tfel(expected.state[k]), rtol=1e-9, atol=1e-13)
        tangent = expected.tangent[k][np.ix_(ORDER, ORDER)]
        np.testing.assert_allclose(K, tangent, atol=1e-9 * np.abs(tangent).max())


def test_random_walks_of_the_better_model(folder, tmp_path):
    """`labkit umat` of such a model writes a behaviour with fifteen more material properties."""
    file = Path(__file__).parents[3] / "results" / "model_benchmark" / "better.json"
    model = Model.from_json(file.read_text(encoding="utf-8"))
    write(tmp_path, properties(model))
    behaviour = behaviour_of(library.build(tmp_path), model)
    names = (ctypes.c_char_p * 51).in_dll(ctypes.CDLL(str(tmp_path / library.NAME)), "labkit_MaterialProperties")
    assert [name.decode() for name in names] == list(properties(model))

    def one(y, increment):
        code, stress, state, K, _, message = behaviour(tfel(y), -increment[ORDER])
        assert code == 1, message
        return tfel(state), -stress[ORDER], K[np.ix_(ORDER, ORDER)]  # ORDER is its own inverse

    assert largest_difference(model, *random_walks(model), one) < 1e-8


def test_prediction_operator_start_and_failure(model, behaviour):
    y = isotropic_state(model, 0.67, 0.5e6).vector()[:21]
    zero = update(model, y[None], np.zeros((1, 6))).tangent[0]
    code, *_, K, _, _ = behaviour(np.zeros(21), np.full(6, 9.0), -1.0, np.array([-5e5, -5e5, -5e5, 0, 0, 0]))
    assert code == 1
    np.testing.assert_allclose(K, zero[np.ix_(ORDER, ORDER)], rtol=1e-9, atol=1e-3)
    code, *_, rdt, message = behaviour(tfel(y), np.array([0.05, 0.05, 0.05, 0, 0, 0]))
    assert code == -1 and rdt == 0.25 and message.startswith(b"labkit: status")


@pytest.mark.parametrize("name", PATHS)
def test_a_path_in_mgis(model, shared_library, name):
    mgis = pytest.importorskip("mgis.behaviour", reason="no Python bindings of MGIS: docs/umat.md builds them")
    expected = curve(name)
    law = mgis.load(str(shared_library), "labkit", mgis.Hypothesis.TRIDIMENSIONAL)
    point = mgis.MaterialDataManager(law, 1)
    for field, value in properties(model, tolerance=TOLERANCE).items():
        for side in (point.s0, point.s1):
            mgis.setMaterialProperty(side, field, value)
    point.s0.internal_state_variables[:] = tfel(expected.state.vector())
    found = []
    for strain in to_six(expected.strain)[1:]:
        point.s1.gradients[:] = -strain[ORDER]
        assert mgis.integrate(point, mgis.IntegrationType.INTEGRATION_NO_TANGENT_OPERATOR, 1.0, 0, 1) == 1
        found.append(np.ravel(point.s1.thermodynamic_forces).copy())
        mgis.update(point)
    assert_same_curve(np.array(found), -to_six(expected.stress)[1:, ORDER])
