"""Section 4, the vision model.

In: what was taught; out: a part's circles and patterns, and how they look from a pose.
"""
