"""Scatter and bias of the critical state against the number of grains.

`campaign.yaml` is the campaign; its runs are reduced to `curves.nc`, from which everything else is computed.
"""
