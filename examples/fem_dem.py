"""FEM x DEM: a quarter of a biaxial test, in scikit-fem, with grains in every element and with the model."""

import numpy as np
import pandas as pd
import skfem
from skfem.helpers import ddot, sym_grad

import labkit as lk
from labkit.micro.tensors import to_six, to_tensor
from labkit.model import Model, isotropic_state, update

SQUARES, GRAINS, STEPS, HEIGHT, PRESSURE = 4, 300, 20, 0.1, 0.5e6  # 2 SQUARES^2 triangles; m; Pa
mesh = skfem.MeshTri.init_tensor(*(np.linspace(0, x, SQUARES + 1) for x in (HEIGHT / 2, HEIGHT))).with_defaults()
basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()), intorder=1)
lateral = skfem.LinearForm(lambda v, w: PRESSURE * v[0]).assemble(skfem.FacetBasis(mesh, basis.elem, facets="right"))
inner = skfem.LinearForm(lambda v, w: ddot(w["s"], sym_grad(v)))
stiff = skfem.BilinearForm(lambda u, v, w: np.einsum("ijkl...,kl...,ij...", w["T"], sym_grad(u), sym_grad(v)))
top, *others = (basis.get_dofs(side).all(u) for side, u in (("top", "u^2"), ("left", "u^1"), ("bottom", "u^2")))
e = [0.65 if np.hypot(x, y) < 0.03 else 0.62 for x, y in mesh.p[:, mesh.t].mean(axis=1).T]  # looser at the centre
sand = {x: lk.consolidate(lk.make_specimen(lk.Recipe(x, grains=GRAINS)), PRESSURE) for x in set(e)}
begin: dict[str, list] = {"grains": [sand[x] for x in e]}
voids = [lk.micro.void_ratio_nominal(state.snapshot()) for state in begin["grains"]]  # consolidation changes them
begin["model"] = [isotropic_state(Model(), x, PRESSURE).vector()[:21] for x in voids]
table = pd.DataFrame(index=pd.Index(np.linspace(0.0, 10.0 * HEIGHT, STEPS + 1), name="settlement (mm)"))
for name, start in begin.items():
    load, strain = [PRESSURE * HEIGHT / 2e3], np.zeros((len(e), 3, 3))
    change = -1e-3 * table.index[1] * np.isin(range(basis.N), top)
    while len(load) <= STEPS:  # each pass is an iteration of Newton's method
        strain[:, :2, :2] = -sym_grad(basis.interpolate(change))[..., 0].T
        if name == "grains":
            found = [lk.Element(one).strain(d) for one, d in zip(start, strain, strict=True)]
            stress, tangent, end = map(list, zip(*found, strict=True))
        else:
            point = update(Model(), np.array(start), to_six(strain))
            stress, tangent, end = list(to_tensor(point.stress)), list(np.array(point.tangent)), list(point.state)
        T = to_tensor(np.moveaxis(to_tensor(np.array(tangent)), 1, -1)).T[:2, :2, :2, :2, :, None]
        out = inner.assemble(basis, s=np.array(stress).T[:2, :2, :, None]) - lateral
        system = skfem.condense(stiff.assemble(basis, T=T), out, D=np.hstack([top, *others]))
        change += skfem.solve(*system)
        if np.linalg.norm(system[1]) < 0.01 * np.linalg.norm(lateral):
            start, load = end, [*load, 1e-3 * abs(out[top].sum())]
    table[name] = load
table.plot(ylabel="load (kN/m)").figure.savefig("fem_dem.png")
