"""The experiments, one file each: agents to train, data, pictures and summary."""
