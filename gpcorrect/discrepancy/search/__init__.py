"""Which effects explain the discrepancy: candidates, trials on the data, and the beam over sets."""
