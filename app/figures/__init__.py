"""Figures of plans, for the command line and the report."""
