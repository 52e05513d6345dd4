"""The human-in-the-loop acquisition of vision models (Section 4)."""
