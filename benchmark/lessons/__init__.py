"""What the teaching page needs of the benchmark: drawn views of a part, and a trial of the model just taught."""
