"""What a residual shows: whitened rows, linear evidence in nats, small structured tests, and where they stand out."""
