"""Do the constants of Table 2 hold for other grains? CV tests with one parameter of the grains changed at a time.

`campaign.yaml` is the campaign; its runs are reduced to `curves.nc`, from which everything else is computed.
"""
