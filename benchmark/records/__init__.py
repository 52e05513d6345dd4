"""What is kept of every episode: its record, the directory of the sweep, and the machine that made it."""
