"""The host of the fused engine: a C++ library that moves data but contains no formulas (build.py compiles it)."""
