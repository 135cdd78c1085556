"""What a run found: figures on the sealed part, words, files."""
