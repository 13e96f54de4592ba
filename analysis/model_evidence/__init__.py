"""What the constitutive model is worth: errors on paths it was not calibrated on, readings, and what C1 to C5 lack."""
