"""Where a simulator and recordings disagree: what is missing, how sure that is, and how much it explains."""
