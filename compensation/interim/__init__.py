"""Interim checks: short checks show when an arm changed and why; later measurements are
re-corrected.
"""
