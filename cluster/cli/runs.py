"""Commands on the runs of a home: `runs` and `sync`."""

from pathlib import Path

import click

from cluster.cli.options import agent_file_option
from cluster.cli.places import home_option, the_tracking_uri, tracking_option


@click.command()
@home_option
def runs(home: Path) -> None:
    """List all studies and other runs: state, progress, best score."""
    from cluster.catalog.overview import overview, print_overview
    from cluster.session.terminal import Terminal
    from cluster.storage.home import Home

    where = Home(home)
    lines = overview(where)
    if lines:
        print_overview(lines, Terminal().console)
    else:
        start = where.hint("nes CartPole-v0", "nes-cartpole")
        click.echo(f"no runs in {str(home)!r} yet: start with {start}")


@click.command()
@click.argument("run")
@home_option
@tracking_option
@agent_file_option
def sync(run: str, home: Path, tracking_uri: str | None, agent_files: tuple[Path, ...]) -> None:
    """Write to MLflow what it lacks of RUN, from the files on disk.

    RUN is the name of a study or of another run, or TASK/NAME if several tasks have that name.
    """
    from bilevel.agents import load_plugins
    from cluster.catalog.sync import sync as write
    from cluster.ray.agent_files import load_agent_file
    from cluster.session.terminal import Terminal
    from cluster.storage.home import Home

    load_plugins()
    for file in agent_files:
        load_agent_file(file)
    where = Home(home)
    folder = where.find(run)
    write(folder, where, the_tracking_uri(tracking_uri, where), Terminal())
