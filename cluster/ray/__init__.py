"""Ray: the connection, the actor pool, and the order in which actors get their requests."""
