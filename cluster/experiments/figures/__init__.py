"""The experiments, one file each: what is asked of agents, and the data, pictures and summary made
of their answers."""
