"""Plays episodes: drops, looks, localises, picks, and compares the answers with the truth; alone or as a sweep."""
