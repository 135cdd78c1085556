"""What a residual says: whitened rows, linear evidence in nats, small structured tests, and where they stand out."""
