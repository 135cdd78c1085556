"""Learns how a cable-driven robot misses its commanded pose, and tells the planner what to command instead."""

from importlib.metadata import version

__version__ = version("gpcorrect")
