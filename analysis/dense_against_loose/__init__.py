"""One critical state for dense and loose specimens, drained?"""
