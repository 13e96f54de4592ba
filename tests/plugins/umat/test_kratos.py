"""Kratos (GeoMechanicsApplication, from PyPI), an independent program, loads the compiled UMAT.

Its material point follows the strain of each of labkit's paths, and must return the stress that labkit's integrator
finds on that path.
"""

import numpy as np
import pytest

from labkit.plugins.umat.props import properties
from tests.plugins.umat.house_paths import PATHS, TOLERANCE, assert_same_curve, curve
from tests.plugins.umat.test_abaqus import components, engineering, statev_of

pytestmark = pytest.mark.slow


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
    expected = curve(name)
    props = properties(model, tolerance=TOLERANCE).values()
    state = expected.state
    point = Point(kratos, shared_library, props, statev_of(state), components(-state.stress(model)))
    found = np.array([point.to(engineering(strain)) for strain in expected.strain[1:]])
    assert_same_curve(found, np.array([components(-stress) for stress in expected.stress[1:]]))
