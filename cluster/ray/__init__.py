"""Ray: connection, actor pool, and the order of requests."""
