"""Files (schema, netCDF, provenance), interruption by signals, and progress."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.io.atomic import whole_file as whole_file
    from labkit.io.atomic import write_text as write_text
    from labkit.io.children import without_current_folder as without_current_folder
    from labkit.io.extras import install_command as install_command
    from labkit.io.files import make_folder as make_folder
    from labkit.io.files import require_writable as require_writable
    from labkit.io.hashes import file_sha256 as file_sha256
    from labkit.io.interruption import die_with_parent as die_with_parent
    from labkit.io.interruption import lock_of as lock_of
    from labkit.io.netcdf import create_variables as create_variables
    from labkit.io.netcdf import finish as finish
    from labkit.io.netcdf import labkit_kind as labkit_kind
    from labkit.io.netcdf import open_netcdf as open_netcdf
    from labkit.io.progress import reporter as reporter
    from labkit.io.provenance import provenance_json as provenance_json
    from labkit.io.provenance import provenance_of as provenance_of
    from labkit.io.provenance import provenance_rows as provenance_rows
    from labkit.io.provenance import write_provenance as write_provenance
    from labkit.io.provenance import write_with_provenance as write_with_provenance
    from labkit.io.schema import CONTACTS as CONTACTS
    from labkit.io.schema import GRAINS as GRAINS
    from labkit.io.schema import RECORD as RECORD
else:
    __getattr__, __dir__, __all__ = attach(__name__)
