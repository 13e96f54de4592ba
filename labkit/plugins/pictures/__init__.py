"""Pictures of grains and force chains in 3D.

render       shaded images of spheres and sticks
frames       what a browser draws, as numbers
picture      images of one or more snapshots
viewer       a page for browsers and notebooks, with a slider over the snapshots
command      the command `labkit picture`
"""
