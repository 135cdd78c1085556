"""The next run to make, chosen by the evidence that it would bring."""
