"""Run files as values: Run, xarray datasets with the accessor `.lab`, quantities of their records, tables."""
