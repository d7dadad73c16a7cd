"""The console script `bilevel`: `program` joins the commands, one module per group of them."""

import sys


def main() -> None:
    """Entry point; invalid input prints one line and exits with code 2, an interruption exits with
    code 130, also while the program is still being loaded."""
    try:
        from cluster.cli.program import run

        run()
    except KeyboardInterrupt:
        sys.exit(130)
