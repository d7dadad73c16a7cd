"""Commands on the runs of a home: `runs` and `sync`."""

from pathlib import Path

import click

from cluster.cli.decorators import agent_file_option, home_option, tracking_option


@click.command()
@home_option
def runs(home: Path) -> None:
    """List all studies and other runs: state, progress, best score."""
    from cluster.catalog.overview import overview, print_overview
    from cluster.session.terminal import Terminal
    from cluster.storage.home import Home

    place = Home(home)
    lines = overview(place)
    if lines:
        print_overview(lines, Terminal().console)
    else:
        start = place.hint("nes CartPole-v0", "nes-cartpole")
        click.echo(f"no runs in {str(home)!r} yet: start with {start}")


@click.command()
@click.argument("run")
@home_option
@tracking_option
@agent_file_option
def sync(run: str, home: Path, tracking_uri: str | None, agent_files: tuple[Path, ...]) -> None:
    """Write the missing parts of RUN to MLflow, from the files on disk.

    RUN is the name of a study or another run, or TASK/NAME if several tasks have a run of that
    name.
    """
    from bilevel.agents import load_plugins
    from cluster.catalog.sync import sync as write
    from cluster.ray.agent_files import load_agent_file
    from cluster.session.terminal import Terminal
    from cluster.storage.home import Home

    load_plugins()
    for file in agent_files:
        load_agent_file(file)
    place = Home(home)
    write(place.find(run), place, tracking_uri or place.database_uri, Terminal())
