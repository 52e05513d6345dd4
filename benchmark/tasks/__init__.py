"""What the robot is asked to do, each task told from top to bottom; none of it knows the truth."""
