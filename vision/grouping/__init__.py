"""Section 5.2, edge grouping.

In: a grey picture; out: fragments, groups of them, and their ellipses by Kalman filter.
"""
