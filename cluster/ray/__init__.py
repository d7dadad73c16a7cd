"""Ray: the connection, the pool of actors, and the order in which these get their requests."""
