"""labkit: a virtual laboratory for granular soil.

`import labkit` needs numpy alone, so that it also works inside YADE's interpreter; the parts that need
xarray are loaded when they are first used.
"""

__version__ = "0.1.0"

_LAZY = {
    "open_run": "labkit.runs.dataset", "open_state": "labkit.runs.dataset",
    "open_campaign": "labkit.campaign.collection",
}  # fmt: skip
__all__ = ["__version__", *_LAZY]


def __getattr__(name):
    if name in _LAZY:
        import importlib

        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'labkit' has no attribute {name!r}")
