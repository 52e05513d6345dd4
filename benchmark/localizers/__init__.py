"""The localizers that a run can ask for: the system itself, the oracle, or the user's own, watched for mistakes."""
