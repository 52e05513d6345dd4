"""The human-in-the-loop acquisition of vision models (Section 4).

In: pictures of a part with known camera poses, and a person's marks; out: the vision model and the
session that made it.
"""
