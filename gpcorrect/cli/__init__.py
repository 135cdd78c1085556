"""The command line: one file a command, and the only place that prints."""

from gpcorrect.cli.app import main

__all__ = ["main"]
