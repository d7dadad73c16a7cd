"""The console script `bilevel`: `program` joins the commands, one module per group of commands."""

import sys


def main() -> None:
    """Run the console script. Invalid input prints one line and exits with code 2. An interruption,
    also during imports, exits with code 130."""
    try:
        from cluster.cli.program import cli

        cli.main()
    except KeyboardInterrupt:
        sys.exit(130)
