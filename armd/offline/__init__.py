"""The offline half as functions and results: what `armd` gives beside the subscriber.

Each name is public as `armd.NAME`; these modules are not. docs/how-to/python.md lists the names.
"""
