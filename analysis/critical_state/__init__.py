"""The critical state at 100 % strain, by density, path, Lode angle, initial fabric, stiffness rule and size.

`campaign.yaml` is the campaign; its runs are reduced to one data set, from which everything else is computed.
"""
