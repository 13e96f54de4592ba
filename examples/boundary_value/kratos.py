"""The biaxial test in Kratos (GeoMechanicsApplication), which loads the compiled UMAT from the shared library.

Eight-node elements with four integration points, drained: the water pressure is fixed at zero. Kratos's Newton strategy
carries out one iteration at each call, so that the residual of every iteration can be recorded. Kratos ignores PNEWDT:
every increment is therefore checked afterwards for points at which the law failed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import KratosMultiphysics as Kratos
import KratosMultiphysics.GeoMechanicsApplication as Geo
import KratosMultiphysics.LinearSolversApplication as Solvers
import numpy as np

from examples.boundary_value import problem
from labkit.errors import PhysicsError
from labkit.model import Model, ModelState, isotropic_state
from labkit.plugins.umat import properties

GAUSS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / np.sqrt(3.0)  # Kratos's order of the four points
POINTS = len(GAUSS)
LAW = "SmallStrainUMAT2DPlaneStrainLaw"
PLAIN = {  # properties that a drained, weightless element requires and that do not change the solution
    "DENSITY_SOLID": 0.0,
    "DENSITY_WATER": 0.0,
    "POROSITY": 0.4,
    "BULK_MODULUS_SOLID": 1e12,
    "BULK_MODULUS_FLUID": 1e12,
    "PERMEABILITY_XX": 1e-12,
    "PERMEABILITY_YY": 1e-12,
    "PERMEABILITY_XY": 0.0,
    "DYNAMIC_VISCOSITY": 1.0,
    "BIOT_COEFFICIENT": 1.0,
    "YOUNG_MODULUS": 1.0,
    "POISSON_RATIO": 0.2,
    "SATURATED_SATURATION": 1.0,
    "GEO_DRAINAGE_TYPE": "CONSTANT_PW_FIELD",
    "RETENTION_LAW": "SaturatedLaw",
}
NODAL = ["DISPLACEMENT", "REACTION", "VELOCITY", "ACCELERATION", "VOLUME_ACCELERATION", "LINE_LOAD"]
NODAL += ["WATER_PRESSURE", "REACTION_WATER_PRESSURE", "DT_WATER_PRESSURE", "TOTAL_DISPLACEMENT"]
NODAL += ["INCREMENTAL_DISPLACEMENT", "HYDRAULIC_DISCHARGE"]  # Kratos writes to all of these without a check
LOST = 1e-6  # difference between void ratio and volumetric strain from which a point has missed an increment


def _variable(name: str) -> Any:
    return Kratos.KratosGlobals.GetVariable(name)


class InKratos(problem.Biaxial):
    """The test in Kratos with the law in a shared library that labkit.plugins.umat.build made."""

    program, element = "Kratos", "eight nodes, four points"

    def __init__(self, columns: int, library: Path, model: Model) -> None:
        """Mesh, boundary conditions and initial states."""
        Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
        self.columns = columns
        self.container = Kratos.Model()  # keeps Python from freeing the parts
        self.part = self.container.CreateModelPart("specimen")
        for name in NODAL:
            self.part.AddNodalSolutionStepVariable(_variable(name))
        self.part.ProcessInfo.SetValue(Kratos.DOMAIN_SIZE, 2)
        material = self._material(library, model)
        self._mesh(material)
        self.part.SetBufferSize(2)
        self.position = np.array([(node.X, node.Y) for node in self.part.Nodes])
        self.displacement = np.zeros_like(self.position)
        self._supports()
        self._solver()
        self.initial = self._initial(model)
        self.steps = 0

    def _material(self, library, model):
        material = self.part.CreateNewProperties(1)
        for name, value in PLAIN.items():
            material.SetValue(_variable(name), value)
        material.SetValue(_variable("UDSM_NAME"), str(library))
        material.SetValue(_variable("IS_FORTRAN_UDSM"), True)
        material.SetValue(Geo.UMAT_PARAMETERS, Kratos.Vector(list(properties(model).values())))
        state = isotropic_state(model, float(problem.void_ratio(problem.WIDTH, problem.HEIGHT)), problem.PRESSURE)
        material.SetValue(_variable("STATE_VARIABLES"), _statev(state))
        material.SetValue(Kratos.CONSTITUTIVE_LAW, Kratos.KratosGlobals.GetConstitutiveLaw(LAW).Clone())
        return material

    def _mesh(self, material):
        nx, ny = 2 * self.columns, 4 * self.columns
        number: dict[tuple[int, int], int] = {}
        for j in range(ny + 1):
            for i in range(nx + 1):
                if i % 2 == 0 or j % 2 == 0:
                    number[i, j] = len(number) + 1
                    self.part.CreateNewNode(number[i, j], i * problem.WIDTH / nx, j * problem.HEIGHT / ny, 0.0)
        ring = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]  # corners, then midsides
        for j in range(0, ny, 2):
            for i in range(0, nx, 2):
                nodes = [number[i + a, j + b] for a, b in ring]
                count = self.part.NumberOfElements() + 1
                self.part.CreateNewElement("UPwSmallStrainElement2D8N", count, nodes, material)
            side = [number[nx, j], number[nx, j + 2], number[nx, j + 1]]
            self.part.CreateNewCondition("UPwFaceLoadCondition2D3N", j // 2 + 1, side, material)

    def _supports(self):
        add = Kratos.VariableUtils().AddDof
        for axis in "XYZ":
            add(_variable(f"DISPLACEMENT_{axis}"), _variable(f"REACTION_{axis}"), self.part)
        add(Kratos.WATER_PRESSURE, Kratos.REACTION_WATER_PRESSURE, self.part)
        self.top = []
        self.unknowns = 2 * self.part.NumberOfNodes()
        for node in self.part.Nodes:
            node.Fix(Kratos.DISPLACEMENT_Z)
            node.Fix(Kratos.WATER_PRESSURE)
            on_top = node.Y > problem.HEIGHT * (1 - 1e-9)
            if on_top:
                self.top.append(node)
            if node.X > problem.WIDTH * (1 - 1e-9):
                node.SetSolutionStepValue(_variable("LINE_LOAD"), Kratos.Array3([-problem.PRESSURE, 0.0, 0.0]))
            for axis, fixed in (("X", node.X == 0.0), ("Y", node.Y == 0.0 or on_top)):
                if fixed:
                    node.Fix(_variable(f"DISPLACEMENT_{axis}"))
                    self.unknowns -= 1

    def _solver(self):
        self.scheme = Geo.BackwardEulerQuasistaticUPwScheme()
        self.builder = Kratos.ResidualBasedBlockBuilderAndSolver(Solvers.SparseLUSolver())
        never = Kratos.DisplacementCriteria(1e-300, 1e-300)
        self.strategy = Kratos.ResidualBasedNewtonRaphsonStrategy(
            self.part, self.scheme, never, self.builder, 1, True, False, False
        )
        self.strategy.SetEchoLevel(0)
        self.strategy.Initialize()
        self.strategy.Check()

    def _initial(self, model):
        """Gives every point its state; returns the void ratios (elements, points)."""
        found = []
        for element in self.part.Elements:
            corners = np.array([(node.X, node.Y) for node in list(element.GetNodes())[:4]])
            points = corners.mean(axis=0) + GAUSS * np.ptp(corners, axis=0) / 2.0
            found.append(problem.void_ratio(*points.T))
            values = [_statev(isotropic_state(model, float(e), problem.PRESSURE)) for e in found[-1]]
            element.SetValuesOnIntegrationPoints(_variable("STATE_VARIABLES"), values, POINTS, self.part.ProcessInfo)
        return np.array(found)

    def uniform(self, strain: float) -> np.ndarray:
        """See Biaxial.uniform."""
        return self.position * [0.0, -strain]

    def increment(self, step: float, start: np.ndarray) -> problem.Increment | None:
        """See Biaxial.increment. Raises PhysicsError if the law failed at a point, which Kratos does not notice."""
        self.steps += 1
        self.part.CloneTimeStep(float(self.steps))
        self.part.ProcessInfo[Kratos.STEP] = self.steps
        end = self.displacement + start
        end[self.position[:, 1] > problem.HEIGHT * (1 - 1e-9), 1] = self._platen() - step * problem.HEIGHT
        self._move(end)
        self.strategy.InitializeSolutionStep()
        residuals = [self._residual()]
        while residuals[-1] >= problem.TOLERANCE:
            if len(residuals) > problem.MOST_ITERATIONS or not np.isfinite(residuals[-1]):
                self._move(self.displacement)
                return None
            self.strategy.SolveSolutionStep()
            residuals.append(self._residual())
        self.strategy.FinalizeSolutionStep()
        before, self.displacement = self.displacement, self._moved()
        self._require_every_point()
        force = abs(sum(node.GetSolutionStepValue(Kratos.REACTION_Y) for node in self.top))
        return problem.Increment(self.displacement - before, force, residuals)

    def _platen(self):
        return float(self.displacement[self.top[0].Id - 1, 1])

    def _move(self, displacement):
        for node, (x, y) in zip(self.part.Nodes, displacement.tolist(), strict=True):
            node.SetSolutionStepValue(Kratos.DISPLACEMENT_X, x)
            node.SetSolutionStepValue(Kratos.DISPLACEMENT_Y, y)

    def _moved(self):
        return np.array([list(node.GetSolutionStepValue(Kratos.DISPLACEMENT))[:2] for node in self.part.Nodes])

    def _residual(self):
        """Norm of the forces at the free displacements, divided by that of the lateral load."""
        out = Kratos.Vector(self.builder.GetEquationSystemSize(), 0.0)
        self.builder.BuildRHS(self.scheme, self.part, out)
        return float(np.linalg.norm(np.array(out))) / self._load()

    def _load(self):
        """Norm of the nodal forces of the lateral load: 1/6, 4/6, 1/6 of a side, 2/6 where two sides meet."""
        sides = 2 * self.columns
        squares = 2 * 1 + (sides - 1) * 4 + sides * 16
        return problem.PRESSURE * problem.HEIGHT / sides * np.sqrt(squares) / 6.0

    def _require_every_point(self):
        """Raise an error where the void ratio does not follow from the volumetric strain: the law has failed."""
        strain = self._points("ENGINEERING_STRAIN_VECTOR")[..., :3].sum(axis=-1)
        lost = np.abs(np.log1p(self.field("e").reshape(strain.shape)) - np.log1p(self.initial) - strain)
        if lost.max() > LOST:
            count = int((lost > LOST).sum())
            raise PhysicsError(f"the law failed at {count} points, which Kratos cannot repeat: use more increments")

    def _points(self, variable):
        found = _variable(variable)
        info = self.part.ProcessInfo
        values = [element.CalculateOnIntegrationPoints(found, info) for element in self.part.Elements]
        return np.array([[np.array(value) for value in element] for element in values])

    def field(self, name: str) -> np.ndarray:
        """See Biaxial.field."""
        if name == "|A|":
            parts = [self._points(f"STATE_VARIABLE_{number}") for number in range(4, 10)]
            values = np.sqrt(sum(weight * part**2 for weight, part in zip((1, 1, 1, 2, 2, 2), parts, strict=True)))
        else:
            values = self._points(f"STATE_VARIABLE_{('e', 'Z').index(name) + 1}")
        return values.reshape(2 * self.columns, self.columns, POINTS)


def _statev(state: ModelState) -> Any:
    """STATEV of an isotropic state."""
    return Kratos.Vector([state.e, state.Z, state.Lam] + 18 * [0.0])
