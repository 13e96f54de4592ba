"""A user-defined loading path: triaxial compression at constant axial stress, in which the radial stress decreases.

    labkit run ca s.state.nc --pressure 300kPa --strain 0.05 --use examples/own_path.py -o r.run.nc
    labkit verify r.run.nc --use examples/own_path.py

In a campaign file: `use: own_path.py`, then `path: ca` in a run.
"""

import dataclasses

import labkit as lk


@lk.register_path
@dataclasses.dataclass(frozen=True)
class ConstantAxialStress(lk.StressPath):
    """sigma_z = `pressure` at a constant axial rate; the servo adjusts the equal radial strain rates."""

    name = "ca"
    direction = (0.0, 0.0, 1.0)  # prescribed: the axial strain rate
    shear = True  # ends in a critical state
    holds = "axial stress"
    line_style = (0, (1, 3))

    def control(self) -> lk.Control:
        """The servo holds sigma_z with equal strain rates in x and y."""
        return lk.Control(measure=[[0, 0, 1]], free=[[1], [1], [0]], target=[self.pressure])


if __name__ == "__main__":
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=500))
    run = lk.run(state, ConstantAxialStress(pressure="300 kPa", strain=0.05))
    print(run, *lk.verify(run), sep="\n")
