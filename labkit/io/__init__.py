"""Files: schema, netCDF, provenance, interruption and progress. Needs only numpy and netCDF4."""

from labkit.lazy import attach

_NAMES = {
    "CONTACTS": "schema",
    "GRAINS": "schema",
    "RECORD": "schema",
    "STATE": "schema",
    "create_variables": "netcdf",
    "make_folder": "files",
    "open_netcdf": "netcdf",
    "require_writable": "files",
    "whole_file": "atomic",
    "write_text": "atomic",
    "labkit_kind": "netcdf",
    "new_netcdf": "netcdf",
    "finish": "netcdf",
    "data_sha256": "hashes",
    "file_sha256": "hashes",
    "provenance_of": "provenance:of_file",
    "provenance_json": "provenance:provenance",
    "provenance_rows": "provenance:rows",
    "write_provenance": "provenance",
    "write_with_provenance": "provenance",
    "install_command": "extras",
    "reporter": "progress",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
