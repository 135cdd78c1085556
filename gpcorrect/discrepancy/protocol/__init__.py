"""The blind protocol: recordings with hidden effects, and the score of the reports on them."""
