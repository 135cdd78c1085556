"""Published studies and the debridement task, done on simulated robots with the package: its users, not part of it."""

# What `gpcorrect` offers of this package: name, where it is, and the line of help (see gpcorrect/cli/app.py).
COMMANDS = {
    "debride": (
        "gpcorrect_studies.debridement.command:debride",
        "Remove fragments with simulated arms: looking often at 1 cm/s, or corrected and in open loop at 6 cm/s.",
    ),
    "reproduce": ("gpcorrect_studies.commands:reproduce_app", "Do a published study again on simulated data."),
}
