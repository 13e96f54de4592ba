"""Exchange with other programs: file formats, what they leave open, sanity checks, import and statistics.

formats        the interface of a file format, and the registry to which users add their own
packing        what a file says; answers: what the user adds; columns: how programs spell the columns of tables
checks         mistakes in sizes, units, box and signs
importing      from a file to a State or a Snapshot
summary        statistics of one Snapshot as text, CSV and JSON
"""

from labkit.lazy import attach

_NAMES = {
    "FORMATS": "formats",
    "Answers": "answers",
    "ContactList": "packing",
    "Finding": "checks",
    "Format": "formats",
    "Imported": "importing",
    "Packing": "packing",
    "import_snapshot": "importing",
    "import_state": "importing",
    "read": "importing",
    "register_format": "formats",
    "state_of": "importing",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
