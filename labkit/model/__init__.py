"""The constitutive model: the stress from C0, its five statistics from the evolution equations C1 to C5.

    parameters   Table 2, the readings of ambiguous equations, and both with E as a Model
    equations    C0 to C5, 31 and 32, each a function that stands next to its number
    state        ModelState: e, Z, Lambda, A, F, F^t, and the isotropic and anisotropic starts
    driver       takes a state along a loading path of labkit.paths, or any mixed control
    integrators  adaptive and fixed-step, explicit and implicit
    stiffness    d sigma/d epsilon, and the hypoplastic form
    material_point   the finite-element interface: many points at once
    calibration  parameters from run files
    run_file     a result as a run file

Compression is positive, z axial, SI units.
"""
