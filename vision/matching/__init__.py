"""Section 6, two-phase matching.

In: ellipses and arcs of all views, a vision model; out: the poses that the edges confirm.
"""
