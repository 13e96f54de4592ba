"""Kratos (GeoMechanicsApplication, from PyPI), a program written elsewhere, loads the compiled UMAT.

Its material point follows the strain of every path of the house, and must return the stress that labkit's integrator
finds on that path.
"""

import numpy as np
import pytest

from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive
from labkit.model.state import isotropic_state
from labkit.umat.properties import properties
from tests.umat.test_abaqus import components, engineering, statev_of

PRESSURE, STRAIN = 0.5e6, 0.01
PATHS = {
    "cv": {"strain": STRAIN},
    "cr": {"strain": STRAIN},
    "cp": {"strain": STRAIN},
    "c1": {"strain": STRAIN},
    "isoc": {"stop_pressure": 0.6e6},
    "isod": {"stop_pressure": 0.3e6},
    "plane_strain": {"strain": STRAIN},
    "oedometer": {"strain": 0.005},
    "true_triaxial": {"strain": STRAIN},
    "simple_shear": {},
}


@pytest.fixture(scope="module")
def kratos():
    """Kratos and its geomechanics application."""
    pytest.importorskip("KratosMultiphysics.GeoMechanicsApplication", reason="KratosGeoMechanicsApplication missing")
    import KratosMultiphysics

    return KratosMultiphysics


class Point:
    """A material point of Kratos with the compiled law; strain and stress as in UMAT."""

    def __init__(self, kratos, file, props, state, stress):
        """`state`: STATEV (21,), `stress` (6,)."""
        import KratosMultiphysics.GeoMechanicsApplication as Geo

        self.kratos, part = kratos, kratos.Model().CreateModelPart("point")
        corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
        self.nodes = [part.CreateNewNode(k, *map(float, x)) for k, x in enumerate(corners, 1)]
        geometry, material = kratos.Tetrahedra3D4(*self.nodes), part.CreateNewProperties(1)
        material.SetValue(kratos.KratosGlobals.GetVariable("UDSM_NAME"), str(file))
        material.SetValue(kratos.KratosGlobals.GetVariable("IS_FORTRAN_UDSM"), True)
        material.SetValue(Geo.UMAT_PARAMETERS, kratos.Vector(list(props)))
        material.SetValue(kratos.KratosGlobals.GetVariable("STATE_VARIABLES"), kratos.Vector(list(state)))
        self.law = kratos.KratosGlobals.GetConstitutiveLaw("SmallStrainUMAT3DLaw").Clone()
        self.stress, self.strain = kratos.Vector(list(stress)), kratos.Vector([0.0] * 6)
        self.tangent, shape = kratos.Matrix(6, 6), kratos.Vector([0.25] * 4)
        self.kept = (part, geometry, material, shape)
        self.law.InitializeMaterial(material, geometry, shape)
        options = kratos.Flags()
        options.Set(kratos.ConstitutiveLaw.USE_ELEMENT_PROVIDED_STRAIN, True)
        options.Set(kratos.ConstitutiveLaw.COMPUTE_STRESS, True)
        self.values = values = kratos.ConstitutiveLawParameters()
        values.SetElementGeometry(geometry)
        values.SetMaterialProperties(material)
        values.SetProcessInfo(part.ProcessInfo)
        values.SetOptions(options)
        values.SetStrainVector(self.strain)
        values.SetStressVector(self.stress)
        values.SetConstitutiveMatrix(self.tangent)
        self.law.InitializeMaterialResponseCauchy(values)

    def to(self, strain):
        """Stress (6,) after loading to a total strain (6,)."""
        for k, value in enumerate(strain):
            self.strain[k] = value
        self.law.CalculateMaterialResponseCauchy(self.values)
        self.law.FinalizeMaterialResponseCauchy(self.values)
        return np.array(list(self.values.GetStressVector()))


@pytest.mark.parametrize("name", PATHS)
def test_a_path_in_kratos(model, kratos, shared_library, name):
    state, options = isotropic_state(model, 0.67, PRESSURE), dict(PATHS[name])
    path = model_path(name, PRESSURE, options.pop("stop_pressure", None), **options)
    expected = drive(model, path, state, 2e-5, Adaptive(1e-11)).require()
    assert len(expected) > 20
    props = properties(model, tolerance=1e-8).values()
    point = Point(kratos, shared_library, props, statev_of(state), components(-state.stress(model)))
    found = np.array([point.to(engineering(strain)) for strain in expected.strain[1:]])
    stresses = np.array([components(-stress) for stress in expected.stress[1:]])
    np.testing.assert_allclose(found / PRESSURE, stresses / PRESSURE, rtol=0, atol=1e-6)
