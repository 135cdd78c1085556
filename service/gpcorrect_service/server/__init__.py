"""Request path in: zenoh callback, bounded queue, worker, reply."""
