"""Request path out: what a planner or an operator asks with."""
