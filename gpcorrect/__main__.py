"""`python -m gpcorrect` is the `gpcorrect` command."""

from gpcorrect.cli import main

main()
