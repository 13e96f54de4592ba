"""What an isotropic stress hides: the fabric left by earlier shear, and Z at equal e and p (Figs. 9, 10).

`campaign.yaml` is the campaign; its runs are reduced to `loading.nc`, from which everything else is computed.
"""
