"""Foreign bytes at every door: payloads to the service, recordings to the readers, model files to their loader."""
