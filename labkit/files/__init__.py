"""Files: the schema of state and run files, netCDF, hashes, provenance; files are written completely or not at all."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.files.atomic import whole_file as whole_file
    from labkit.files.atomic import write_text as write_text
    from labkit.files.hashes import file_sha256 as file_sha256
    from labkit.files.netcdf import create_variables as create_variables
    from labkit.files.netcdf import finish as finish
    from labkit.files.netcdf import hash_verdict as hash_verdict
    from labkit.files.netcdf import labkit_kind as labkit_kind
    from labkit.files.netcdf import open_netcdf as open_netcdf
    from labkit.files.provenance import provenance_json as provenance_json
    from labkit.files.provenance import provenance_of as provenance_of
    from labkit.files.provenance import provenance_rows as provenance_rows
    from labkit.files.provenance import write_provenance as write_provenance
    from labkit.files.provenance import write_with_provenance as write_with_provenance
    from labkit.files.schema import CONTACTS as CONTACTS
    from labkit.files.schema import GRAINS as GRAINS
    from labkit.files.schema import RECORD as RECORD
    from labkit.files.writable import make_folder as make_folder
    from labkit.files.writable import require_writable as require_writable
else:
    __getattr__, __dir__, __all__ = attach(__name__)
