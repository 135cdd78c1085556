"""Which names may be given: posteriors against none, rivals and the unknown, and intervals of the numbers."""
