"""What those who run a site need: certificates, router, diagnosis, metrics, log."""
