"""Loading paths beyond the paper's: the error of C0 outside triaxial compression, and the strength on other paths.

`paths.yaml` is the campaign; `collect.py` reduces its runs to one data set, from which everything else is computed.
"""
