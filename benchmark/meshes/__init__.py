"""Meshes that a user brings: reads a file and makes one solid of it, or says why there is none."""
