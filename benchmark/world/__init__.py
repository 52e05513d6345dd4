"""The simulated cell: parts, the scene that they are dropped into, the camera that looks, and the truth."""
