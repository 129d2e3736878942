"""Verification of an arm's specification: ISO 10360-12 and ASME B89.4.22."""
