"""Which effects explain the discrepancy: candidates, their signatures in the data, and the search over sets."""
