"""Studies of the teaching: a simulated person with an unsteady hand teaches the parts anew for every variant."""
