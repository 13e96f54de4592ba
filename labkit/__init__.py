"""labkit: a virtual laboratory for granular soil.

    import labkit as lk

    scene = lk.Scene(friction=0.5)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=2000), scene)
    run = lk.run(state, lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.05))
    run.complete, run.exceeded, run.data, run.plot()
    lk.statistics(run.snapshots[-1]), lk.love_stress(run.snapshots[-1]), lk.sff_stress(run.snapshots[-1])

Modules are loaded on first use.
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach
from labkit.version import __version__ as __version__

if TYPE_CHECKING:
    from labkit import figures as figures
    from labkit import micro as micro
    from labkit import model as model
    from labkit import paths as paths
    from labkit import sff as sff
    from labkit.bodies.shapes import Shape as Shape
    from labkit.bodies.shapes import register_shape as register_shape
    from labkit.engines.base import Engine as Engine
    from labkit.engines.base import register_engine as register_engine
    from labkit.engines.device import Fused as Fused
    from labkit.engines.device import Yade as Yade
    from labkit.engines.lammps.plugin import Lammps as Lammps
    from labkit.errors import InputError as InputError
    from labkit.errors import Interrupted as Interrupted
    from labkit.errors import PhysicsError as PhysicsError
    from labkit.extensions import use as use
    from labkit.grains import laws as laws
    from labkit.grains.bonds import bond as bond
    from labkit.grains.laws import ContactLaw as ContactLaw
    from labkit.grains.registration import register_law as register_law
    from labkit.grains.scene import Scene as Scene
    from labkit.grains.state import State as State
    from labkit.grains.state_file import read_state as read_state
    from labkit.grains.state_file import write_state as write_state
    from labkit.micro.fabric import statistics as statistics
    from labkit.micro.snapshot import Contacts as Contacts
    from labkit.micro.snapshot import Snapshot as Snapshot
    from labkit.micro.snapshot import love_stress as love_stress
    from labkit.micro.stress import deviatoric_stress as deviatoric_stress
    from labkit.micro.stress import mean_stress as mean_stress
    from labkit.parameters import parameter as parameter
    from labkit.paths.control import Control as Control
    from labkit.paths.path import Held as Held
    from labkit.paths.path import Path as Path
    from labkit.paths.path import StressPath as StressPath
    from labkit.paths.path_file import read_path as read_path
    from labkit.paths.registry import register_path as register_path
    from labkit.plugins import exchange as exchange
    from labkit.plugins import laboratory_data as laboratory_data
    from labkit.plugins.calibration.fitting import calibrate as calibrate
    from labkit.plugins.campaigns.collection import open_campaign as open_campaign
    from labkit.plugins.campaigns.collection import open_runs as open_runs
    from labkit.plugins.densities.preparation import density_limits as density_limits
    from labkit.plugins.densities.preparation import specimen_at as specimen_at
    from labkit.plugins.exchange.formats import register_format as register_format
    from labkit.plugins.exchange.importing import import_snapshot as import_snapshot
    from labkit.plugins.exchange.importing import import_state as import_state
    from labkit.plugins.laboratory_data.comparing import misfit as misfit
    from labkit.plugins.laboratory_data.posterior import Posterior as Posterior
    from labkit.plugins.laboratory_data.posterior import calibrate_grains as calibrate_grains
    from labkit.plugins.laboratory_data.reading import read_measured as read_measured
    from labkit.plugins.laboratory_data.reading import write_measured as write_measured
    from labkit.plugins.laboratory_data.sampling import GrainTests as GrainTests
    from labkit.plugins.probes.grains import probe as probe
    from labkit.plugins.probes.probe_set import Probes as Probes
    from labkit.plugins.probes.probe_set import read_probes as read_probes
    from labkit.plugins.probes.probing import Probing as Probing
    from labkit.quantities.recorded import register_statistic as register_statistic
    from labkit.records.limits import Exceeded as Exceeded
    from labkit.records.schedule import Options as Options
    from labkit.results.compression import compression_numbers as compression_numbers
    from labkit.results.critical import critical_line as critical_line
    from labkit.results.critical import critical_states as critical_states
    from labkit.results.dataset import open_run as open_run
    from labkit.results.dataset import open_state as open_state
    from labkit.results.figures import register_figure as register_figure
    from labkit.results.run import Run as Run
    from labkit.results.verify import verify as verify
    from labkit.servo.correction import Servo as Servo
    from labkit.sff.c0 import sff_stress as sff_stress
    from labkit.sff.c0 import sff_stress_by_volume as sff_stress_by_volume
    from labkit.simulation.api import consolidate as consolidate
    from labkit.simulation.api import make_specimen as make_specimen
    from labkit.simulation.api import run as run
    from labkit.simulation.batch import run_many as run_many
    from labkit.simulation.element import Element as Element
    from labkit.specimens.recipe import Recipe as Recipe

    __all__: list[str]
else:
    __getattr__, __dir__, __all__ = attach(__name__)
    __all__ += ["__version__"]
