"""TCP ports of this machine."""

import socket

from bilevel.errors import InvalidInput


def require_free(host: str, port: int) -> None:
    """Raise InvalidInput if no server can bind to the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InvalidInput(f"cannot serve on {host}:{port}: {error.strerror}") from None


def free_port() -> int:
    """A port that is currently unused."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def reachable(host: str) -> str:
    """Address at which this machine reaches a server bound to `host`."""
    return "127.0.0.1" if host in ("0.0.0.0", "localhost") else host
