"""Times the vision step and its stages (`make bench`); knows all other rooms, and none knows it."""
