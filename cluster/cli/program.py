"""All commands of `bilevel`."""

import io
import sys
from typing import Any

import click

from bilevel.errors import InvalidInput
from cluster.cli.evaluate import evaluate
from cluster.cli.experiment import experiment
from cluster.cli.files import export_se, import_se
from cluster.cli.learn import bohb, nes
from cluster.cli.runs import runs, sync
from cluster.cli.services import down, status, ui, up
from cluster.cli.show import show
from cluster.cli.zoo import build, zoo


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="bilevel")
def cli() -> None:
    """Learn synthetic environments for reinforcement learning."""


def not_empty(context: click.Context, option: click.Parameter, value: Any) -> Any:
    """The value of an option. Raises BadParameter for an empty text, as of an unset variable."""
    if value == "":
        raise click.BadParameter("'' is empty: give a value, or leave the option out")
    return value


COMMANDS = (
    nes,
    bohb,
    evaluate,
    experiment,
    show,
    zoo,
    export_se,
    import_se,
    runs,
    sync,
    up,
    status,
    down,
    ui,
)

for command in COMMANDS:
    cli.add_command(command)
for option in (option for command in (*COMMANDS, build) for option in command.params):
    if isinstance(option.type, click.types.StringParamType) and option.callback is None:
        option.callback = not_empty


def run() -> None:
    """Run the command that the arguments of this process name, and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what the encoding lacks
    try:
        code = cli.main(standalone_mode=False)
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


def _fail(message: str) -> None:
    click.echo(f"bilevel: {' '.join(message.split())}", err=True)
    sys.exit(2)
