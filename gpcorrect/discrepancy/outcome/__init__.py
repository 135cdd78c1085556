"""What a run found: figures on the test set, words, files."""
