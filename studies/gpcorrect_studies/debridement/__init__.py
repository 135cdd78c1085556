"""Debridement on two simulated arms: fragments are found, grasped, lifted, carried and dropped."""
