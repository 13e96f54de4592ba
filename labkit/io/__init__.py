"""Files: schema, netCDF, provenance, interruption and progress. Needs only numpy and netCDF4."""

from labkit.lazy import attach

_NAMES = {
    "CONTACTS": "schema",
    "GRAINS": "schema",
    "RECORD": "schema",
    "STATE": "schema",
    "create_variables": "files",
    "make_folder": "files",
    "open_netcdf": "files",
    "require_writable": "files",
    "whole_file": "files",
    "write_text": "files",
    "labkit_kind": "files",
    "data_sha256": "provenance",
    "file_sha256": "provenance",
    "provenance_of": "provenance:of_file",
    "provenance_json": "provenance:provenance",
    "provenance_rows": "provenance:rows",
    "write_provenance": "provenance",
    "write_with_provenance": "provenance",
    "install_command": "extras",
    "reporter": "progress",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
