"""All commands of `bilevel`."""

import sys
from typing import Any, NoReturn

import click

from bilevel.errors import InvalidInput
from cluster.cli.evaluate import evaluate, experiment
from cluster.cli.home import runs, sync, ui
from cluster.cli.learn import bohb, nes
from cluster.cli.ses import export_se, recipe, show, zoo


class _Program(click.Group):
    """Group that reports all invalid input as one line and exit code 2."""

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Run the command and exit."""
        try:
            code = super().main(*args, **{**options, "standalone_mode": False})
            sys.exit(code if isinstance(code, int) else 0)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message(), err=True)
            sys.exit(2)
        except click.ClickException as error:
            message = error.format_message()
        except InvalidInput as error:
            message = str(error)
        except click.Abort:
            sys.exit(130)
        click.echo(f"bilevel: {' '.join(message.split())}", err=True)
        sys.exit(2)


@click.group(
    cls=_Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(package_name="bilevel")
def cli() -> None:
    """Learn synthetic environments for reinforcement learning."""


for command in (nes, bohb, evaluate, experiment, show, recipe, zoo, export_se, runs, sync, ui):
    cli.add_command(command)
