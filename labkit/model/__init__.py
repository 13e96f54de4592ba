"""The constitutive model: C0 gives the stress, and the evolution equations C1 to C5 give its five statistics.

    parameters   Table 2, the interpretations of ambiguous equations (Readings), and Model, which combines both with E
    equations    C0 to C5, Eqs. 31 and 32, one function per equation
    state        ModelState: e, Z, Lambda, A, F, F^t, and the isotropic and anisotropic initial states
    law          what the driver requires of any law; registry lists all laws
    driver       loads a state along a loading path of labkit.paths.standard, or under any mixed control
    integrators  the adaptive integrator; benchmarks/integrators.py has others
    stiffness    d sigma/d epsilon, and the hypoplastic form
    run_file     writes a result as a run file
    strength     sections of the critical state and of strength criteria in the deviatoric plane

Plug-ins: calibration fits the parameters to runs, umat updates many points for finite elements.

`from labkit.model import Model, isotropic_state, drive` and similar imports load only the modules they need.
Compression is positive, z is axial, units are SI.
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.model.controls import Mixed as Mixed
    from labkit.model.controls import Oedometer as Oedometer
    from labkit.model.controls import model_path as model_path
    from labkit.model.controls import strain_control as strain_control
    from labkit.model.driver import Point as Point
    from labkit.model.driver import Result as Result
    from labkit.model.driver import drive as drive
    from labkit.model.equations import critical_coordination_number as critical_coordination_number
    from labkit.model.equations import critical_force as critical_force
    from labkit.model.equations import density_distance as density_distance
    from labkit.model.integrators import Adaptive as Adaptive
    from labkit.model.integrators import Failure as Failure
    from labkit.model.integrators import Problem as Problem
    from labkit.model.law import ConstitutiveLaw as ConstitutiveLaw
    from labkit.model.law import RateLaw as RateLaw
    from labkit.model.parameters import MEASURED as MEASURED
    from labkit.model.parameters import MEASURED_REVERSALS as MEASURED_REVERSALS
    from labkit.model.parameters import ROOT_3_2 as ROOT_3_2
    from labkit.model.parameters import DensityDependence as DensityDependence
    from labkit.model.parameters import Model as Model
    from labkit.model.parameters import Parameters as Parameters
    from labkit.model.parameters import Readings as Readings
    from labkit.model.parameters import Reversals as Reversals
    from labkit.model.registry import MODELS as MODELS
    from labkit.model.run_file import MODEL_ENGINE as MODEL_ENGINE
    from labkit.model.run_file import as_run as as_run
    from labkit.model.run_file import read_law as read_law
    from labkit.model.run_file import read_model as read_model
    from labkit.model.run_file import records_of_result as records_of_result
    from labkit.model.run_file import write_result as write_result
    from labkit.model.state import ModelState as ModelState
    from labkit.model.state import isotropic_state as isotropic_state
    from labkit.model.state import state_of as state_of
    from labkit.model.state import with_inherent_anisotropy as with_inherent_anisotropy
    from labkit.model.stiffness import hypoplastic_form as hypoplastic_form
    from labkit.model.stiffness import rate_tangent as rate_tangent
    from labkit.model.stiffness import state_rate as state_rate
    from labkit.model.stiffness import stress_rate as stress_rate
    from labkit.model.strength import attractors as attractors
    from labkit.model.strength import critical_section as critical_section
    from labkit.model.strength import matsuoka_nakai as matsuoka_nakai
    from labkit.model.strength import mohr_coulomb as mohr_coulomb
    from labkit.model.strength import principal_cosines as principal_cosines
    from labkit.plugins.calibration.fitting import Fit as Fit
    from labkit.plugins.calibration.fitting import calibrate as calibrate
    from labkit.plugins.calibration.fitting import fit as fit
    from labkit.plugins.calibration.observation import Observation as Observation
    from labkit.plugins.calibration.observation import observe as observe
    from labkit.plugins.umat.material_point import states as states
    from labkit.plugins.umat.material_point import update as update
else:
    __getattr__, __dir__, __all__ = attach(__name__)
