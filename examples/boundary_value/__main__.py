"""A biaxial test in scikit-fem and in Kratos, whichever is installed, with the compiled law.

python -m examples.boundary_value, in a clone with labkit[fem] or labkit[kratos], gfortran and gcc.
"""

import importlib.util
import tempfile
from pathlib import Path

from examples.boundary_value.problem import Biaxial
from labkit.model import Model
from labkit.plugins.umat import Library, build, copy_sources


def main(columns: int = 8, strain: float = 0.01, increments: int = 20) -> None:
    """Solve the test on `columns` x `2 columns` elements, then a cycle of this strain, and print how Newton fared."""
    model = Model()
    with tempfile.TemporaryDirectory() as scratch:
        copy_sources(Path(scratch))
        library = build(Path(scratch))
        problems: list[Biaxial] = []
        if importlib.util.find_spec("skfem"):
            from examples.boundary_value.scikit_fem import ScikitFem

            problems.append(ScikitFem(columns, Library(library, model).update, model))
        if importlib.util.find_spec("KratosMultiphysics"):
            from examples.boundary_value.kratos import InKratos

            problems.append(InKratos(columns, library, model))
        for problem in problems:
            history = problem.run(strain, increments, lambda done, text: None)
            stress, iterations = history.stress[-1] / 1e6, history.iterations.mean()
            print(f"{problem.program}: {stress:.4f} MPa at {history.strain[-1]:.2%} axial strain, "
                  f"{iterations:.2f} iterations per increment")  # fmt: skip
            back = (-2.0 * strain, 2.0 * strain)
            cycle = [problem.run(change, 2 * increments, lambda done, text: None) for change in back]
            counts = [int(count) for part in cycle for count in part.iterations]
            print(f"{problem.program}: {sum(counts) / len(counts):.2f} iterations per increment over one cycle, "
                  f"at most {max(counts)}, {sum(part.cuts for part in cycle)} increments halved")  # fmt: skip


if __name__ == "__main__":
    main()
