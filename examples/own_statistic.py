"""A user-defined statistic, recorded during a run, and its figure: the fraction of sliding contacts.

labkit run cv s.state.nc --strain 0.05 --use examples/own_statistic.py -o r.run.nc
labkit figure records r.run.nc --variable sliding_fraction
labkit figure sliding r.run.nc --use examples/own_statistic.py
"""

import matplotlib.pyplot as plt
import numpy as np

import labkit as lk


@lk.register_statistic("sliding_fraction", long_name="fraction of contacts at the friction limit")
def sliding_fraction(snapshot: lk.Snapshot) -> float:
    """Fraction of contacts with |ft| >= 0.999 mu fn; NaN without contacts."""
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.nan
    tangential = np.linalg.norm(contacts.tangential_force, axis=1)
    return float(np.mean(tangential >= 0.999 * snapshot.scene.friction * contacts.normal_force))


@lk.register_figure("sliding")
def sliding(run):
    """Fraction of sliding contacts against the stress ratio: a Figure and its table."""
    ratio = run.lab.deviatoric_stress() / run.lab.mean_stress()
    figure, axes = plt.subplots(layout="constrained")
    axes.plot(ratio, 100 * run["sliding_fraction"], "o-", ms=3)
    axes.set(xlabel="stress ratio q/p", ylabel="sliding contacts (%)")
    return figure, run["sliding_fraction"].to_dataframe()
