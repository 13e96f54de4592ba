"""Reads runs: Run, xarray datasets with the accessor `.lab`, quantities of their records, and tables."""
