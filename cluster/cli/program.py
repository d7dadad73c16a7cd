"""All commands of `bilevel`."""

import io
import re
import sys
from typing import Any, NoReturn

import click

from bilevel.errors import InvalidInput
from cluster.cli.evaluate import evaluate
from cluster.cli.experiment import experiment
from cluster.cli.files import export_se
from cluster.cli.learn import bohb, nes
from cluster.cli.runs import runs, sync
from cluster.cli.show import recipe, show
from cluster.cli.ui import ui
from cluster.cli.zoo import zoo


class _Program(click.Group):
    """Group that reports all invalid input as one line and exit code 2."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, but reject empty values, such as unset shell variables."""
        for option, value in zip(["", *args], args, strict=False):
            if value == "" or re.fullmatch("--[a-z-]+=", value):
                name = value.rstrip("=") or option
                raise click.UsageError(f"{name}: the value is empty: give one, or omit the option")
        return super().parse_args(ctx, args)

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Run the command and exit."""
        try:
            code = super().main(*args, **{**options, "standalone_mode": False})
            sys.exit(code if isinstance(code, int) else 0)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message(), err=True)
            sys.exit(2)
        except click.ClickException as error:
            _fail(error.format_message())
        except InvalidInput as error:
            _fail(str(error))
        except PermissionError as error:
            _fail(f"no permission to use {str(error.filename)!r}")
        except click.Abort:
            sys.exit(130)


@click.group(
    cls=_Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(package_name="bilevel")
def cli() -> None:
    """Learn synthetic environments for reinforcement learning."""


for command in (
    *(nes, bohb, evaluate, experiment),
    *(show, recipe, zoo, export_se),
    *(runs, sync, ui),
):
    cli.add_command(command)


def run() -> None:
    """Run the command that the arguments of this process name, and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # for characters that the encoding lacks
    cli.main()


def _fail(message: str) -> NoReturn:
    click.echo(f"bilevel: {' '.join(message.split())}", err=True)
    sys.exit(2)
