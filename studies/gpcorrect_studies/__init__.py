"""Published studies and the debridement task, done on simulated robots with the package: its users, not part of it."""
