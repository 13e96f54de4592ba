"""Calibration of the constitutive model: its parameters, fitted to runs of grains.

observation  the data of a run that the calibration uses
residuals    the least-squares problem: unknowns, predictions along the recorded strain, residuals
fitting      the fit, its intervals and its report
figure       the runs and the fitted model
command      the command `labkit calibrate`
"""
