"""Parts of `bench/soak.py`: planners, the site that they ask, what befalls it, and how answers are checked."""
