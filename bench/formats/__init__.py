"""Recordings of many formats, written to their published descriptions, and what independent readers see in them."""
