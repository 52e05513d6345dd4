"""Section 5.1, region growing.

In: a grey picture; out: regions with attributes, and the ellipses on their boundaries.
"""
