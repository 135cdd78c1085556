"""Other libraries' regressions behind one interface, a file a library."""
