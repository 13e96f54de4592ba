"""The laboratory in a web page: labkit itself, in Pyodide, with its kernels as WebAssembly.

form         what the page offers, from labkit's tables, and the tests that the choices make
panels       what the page draws of a record and of a snapshot
bench        carries out the tests in the page
site         writes the page as static files, with exercises.json: tests to choose, with the numbers that they give
command      the command `labkit page`
"""
