"""The offline half of armd as functions and results.

Each name is public as `armd.NAME`; these modules are not. docs/how-to/python.md lists the names.
"""
