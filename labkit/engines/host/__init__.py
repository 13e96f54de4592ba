"""The host of the fused engine: a C++ library that moves data and knows no formula (build.py compiles it)."""
