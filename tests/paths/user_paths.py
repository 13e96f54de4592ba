"""Two user-defined paths and a program that runs one of them: `user_paths.py PATH STATE ENGINE RUN_FILE`.

The program prints JSON. It is a separate file because YADE loads it without pytest.
"""

import dataclasses
import json
import sys

import numpy as np

import labkit as lk


@lk.register_path
@dataclasses.dataclass(frozen=True)
class PlaneStrain(lk.StressPath):
    """Plane strain compression: eps_y = 0, sigma_x held at `pressure`."""

    name = "own_plane_strain"
    shear = True
    holds = "lateral stress"

    def control(self):
        """The servo holds sigma_x by the strain rate in x."""
        return lk.Control(measure=[[1, 0, 0]], free=[[1], [0], [0]], target=[self.held_pressure])

    def held(self):
        """The lateral stress and the plane."""
        return (*super().held(), lk.Held("plane strain", "strain", measure=np.eye(3)[[1]]))


@lk.register_path
@dataclasses.dataclass(frozen=True)
class Extension(lk.Path):
    """Triaxial extension at constant volume."""

    strain: float = lk.parameter(-0.005, low=-1.0, high=-1e-6, help="axial strain to reach")

    name = "extension"
    direction = (-0.5, -0.5, 1.0)

    def held(self):
        """The volume."""
        return (lk.Held("volume", "volume"),)


def main(name, state, engine, file):
    """Run a path, verify its run file and print the result."""
    path = PlaneStrain(strain=0.01, rate=20.0) if name == "plane_strain" else Extension(rate=20.0)
    run = lk.run(lk.read_state(state), path, engine=engine, file=file, snapshots=2, progress=False)
    run.plot()
    checks = {finding.name: finding.holds for finding in lk.verify(file) if finding.name.startswith("held:")}
    strain, stress = run.data["strain"].values, run.data["stress"].values
    q = float(run.data.lab.q()[-1])
    print(json.dumps({"checks": checks, "strain": strain.tolist(), "stress": stress[-1].tolist(), "q": q}))


if __name__ == "__main__":
    main(*sys.argv[1:])
