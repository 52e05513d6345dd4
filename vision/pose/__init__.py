"""Section 7, the pose. In: a start and edges or ellipses of all views; out: a refined pose with its covariance."""
