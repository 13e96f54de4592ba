"""The constitutive model: the stress from C0, its five statistics from the evolution equations C1 to C5.

    parameters   Table 2, the interpretations of ambiguous equations (Readings), and both with E as a Model
    equations    C0 to C5, Eqs. 31 and 32, one function per equation
    state        ModelState: e, Z, Lambda, A, F, F^t, and the isotropic and anisotropic initial states
    driver       loads a state along a loading path of labkit.dem.paths, or under any mixed control
    integrators  adaptive and fixed-step, explicit and implicit
    stiffness    d sigma/d epsilon, and the hypoplastic form
    material_point   the finite-element interface: many points at once
    observation  the data of a run that are used in calibration
    probes       small increments of strain or stress in many directions
    calibration  parameters from run files
    run_file     a result as a run file
    strength     sections of the critical state and of strength criteria in the deviatoric plane

`from labkit.model import Model, isotropic_state, drive` and similar imports load only the modules they need.
Compression is positive, z axial, SI units.
"""

from labkit.lazy import attach

_NAMES = {
    "Model": "parameters",
    "Parameters": "parameters",
    "Readings": "parameters",
    "ROOT_3_2": "parameters",
    "ModelState": "state",
    "isotropic_state": "state",
    "with_inherent_anisotropy": "state",
    "drive": "driver",
    "Result": "driver",
    "model_path": "controls",
    "Mixed": "controls",
    "Oedometer": "controls",
    "Adaptive": "integrators",
    "state_rate": "stiffness",
    "stress_rate": "stiffness",
    "rate_tangent": "stiffness",
    "hypoplastic_form": "stiffness",
    "state_of": "state",
    "probe": "probes",
    "states": "material_point",
    "update": "material_point",
    "calibrate": "calibration",
    "fit": "calibration",
    "Fit": "calibration",
    "Observation": "observation",
    "observe": "observation",
    "density_distance": "equations",
    "critical_coordination_number": "equations",
    "critical_force": "equations",
    "read_model": "run_file",
    "as_run": "run_file",
    "critical_section": "strength",
    "matsuoka_nakai": "strength",
    "mohr_coulomb": "strength",
    "records": "run_file",
    "write_result": "run_file",
    "MODEL_ENGINE": "run_file:ENGINE",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
