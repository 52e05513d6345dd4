"""Tuning seeds in; out come the constants of `vision` that fit them best, and how these and those in the code do."""
