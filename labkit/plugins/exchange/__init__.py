"""Exchange with other programs: file formats, missing information, sanity checks, import and statistics.

formats        the interface of a file format, and the registry to which users add their own formats
packing        the content of a file, and the information that the user adds
columns        the names of columns in tables
checks         finds mistakes in sizes, units, box and signs
importing      makes a State or a Snapshot from a file
summary        writes statistics of one Snapshot as text, CSV and JSON
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.exchange.contact_list import ContactList as ContactList
    from labkit.plugins.exchange.formats import FORMATS as FORMATS
    from labkit.plugins.exchange.formats import Format as Format
    from labkit.plugins.exchange.importing import read as read
    from labkit.plugins.exchange.packing import Answers as Answers
    from labkit.plugins.exchange.packing import Packing as Packing
else:
    __getattr__, __dir__, __all__ = attach(__name__)
