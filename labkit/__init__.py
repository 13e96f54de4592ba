"""labkit: a virtual laboratory for granular soil.

    import labkit as lk

    scene = lk.Scene(friction=0.5)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=1000), scene)
    run = lk.run(state, lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.05))
    run.complete, run.exceeded, run.data, run.plot()
    lk.statistics(run.snapshots[-1]), lk.love_stress(run.snapshots[-1]), lk.sff_stress(run.snapshots[-1])

Modules are loaded on first use; everything that a simulation needs also works inside YADE's interpreter.
"""

from labkit.lazy import attach

__version__ = "0.2.0.dev0"

_NAMES = {
    # model
    "Scene": "dem.scene",
    "Recipe": "dem.specimen",
    "State": "dem.state",
    "Options": "dem.simulation",
    "paths": "dem.paths:",
    "Path": "dem.paths",
    "StressPath": "dem.paths",
    "Control": "dem.paths",
    "Held": "dem.paths",
    "laws": "dem.laws:",
    "ContactLaw": "dem.laws",
    "Engine": "dem.engine",
    "Servo": "dem.servo",
    # simulation
    "make_specimen": "runs.laboratory",
    "consolidate": "runs.laboratory",
    "run": "runs.laboratory",
    "run_batch": "runs.batch",
    "probe": "runs.probes",
    "Probing": "dem.probes",
    "read_state": "dem.state",
    "write_state": "dem.state",
    # results
    "Run": "runs.run",
    "Exceeded": "dem.limits",
    "Snapshot": "micro.snapshot",
    "Contacts": "micro.contacts",
    "open_run": "runs.dataset",
    "open_state": "runs.dataset",
    "Probes": "runs.probe_set",
    "open_probes": "runs.probe_set",
    "open_campaign": "campaign.collection",
    "read_path": "campaign.path_file",
    "statistics": "micro.fabric",
    "love_stress": "micro.stress",
    "sff_stress": "sff.c0",
    "mean_stress": "micro.stress",
    "deviatoric_stress": "micro.stress",
    "verify": "runs.verify",
    "import_state": "exchange.importing",
    "import_snapshot": "exchange.importing",
    "critical_states": "runs.critical",
    "calibrate": "model.calibration",
    # packages
    "micro": "micro:",
    "sff": "sff:",
    "model": "model:",
    "visuals": "visuals:",
    "exchange": "exchange:",
    # extensions
    "parameter": "parameters",
    "use": "extensions",
    "register_path": "dem.paths",
    "register_law": "dem.laws",
    "register_engine": "engines",
    "register_statistic": "dem.recorded",
    "register_figure": "runs.figures",
    "register_format": "exchange.formats",
    # exceptions
    "InputError": "errors",
    "PhysicsError": "errors",
    "Interrupted": "errors",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
__all__ += ["__version__"]
