"""The console script `bilevel`."""

import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from bilevel.errors import InvalidInput
from bilevel.tasks import Task

_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


class _Duration(click.ParamType[float]):
    """`90s`, `45m`, `2h`, or plain seconds; a float of seconds."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", str(value))
        if match is None or float(match[1]) == 0:
            self.fail(f"{value!r} is not a duration: allowed are 90s, 45m, 2h")
        return float(match[1]) * _SECONDS[match[2]]


def _shared(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options that `nes` and `bohb` have in common."""
    positive = click.IntRange(min=1)
    options = [
        click.argument("task"),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True),
        click.option("--population", type=positive, help="NES members a generation."),
        click.option("--address", help="Ray cluster to join (host:port, auto); else a local one."),
        click.option("--tracking-uri", help="MLflow server or database; else one in the home."),
        click.option(
            "--home",
            type=click.Path(path_type=Path),
            default="runs",
            show_default=True,
            help="Folder for checkpoints, journals, and MLflow's database.",
        ),
        click.option("--solved-reward", type=float, help="For tasks whose spec has none."),
        click.option("--step-limit", type=positive, help="For tasks whose spec has none."),
    ]
    for option in reversed(options):
        function = option(function)
    return function


@dataclass(frozen=True)
class _Common:
    """The values of these options."""

    task: str
    seed: int
    population: int | None
    address: str | None
    tracking_uri: str | None
    home: Path
    solved_reward: float | None
    step_limit: int | None

    def the_task(self) -> Task:
        from bilevel.tasks import get_task

        return get_task(self.task, self.solved_reward, self.step_limit)

    def uri(self) -> str:
        """The tracking URI: given, of the environment, or the home's database."""
        from cluster.home import Home

        given = self.tracking_uri or os.environ.get("MLFLOW_TRACKING_URI")
        return given or Home(self.home).database_uri


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="bilevel")
def cli() -> None:
    """Learn synthetic environments for reinforcement learning."""


@cli.command()
@_shared
@click.option("--preset", default=None, help="tuned (the paper's Table 1) or default.")
@click.option("--agent", default="ddqn", show_default=True, help="Agent of the inner loop.")
@click.option("--update", default="antithetic", show_default=True, help="NES update rule.")
@click.option("--generations", type=click.IntRange(min=1), help="At most; default 200.")
@click.option("--workers", type=click.IntRange(min=1), help="Actors; default all cores.")
@click.option("--vary-hp/--no-vary-hp", default=False, help="Vary the agents' hyperparameters.")
@click.option("--start-candidates", type=click.IntRange(min=1), help="Initialisations to try.")
@click.option(
    "--solved-for",
    type=click.IntRange(min=1),
    default=5,
    show_default=True,
    help="Stop early once solved for so many generations in a row, and confirmed.",
)
@click.option("--name", help="Of the run; the same name goes on where it was.")
def nes(
    preset: str | None,
    agent: str,
    update: str,
    generations: int | None,
    workers: int | None,
    vary_hp: bool,
    start_candidates: int | None,
    solved_for: int,
    name: str | None,
    **options: Any,
) -> None:
    """One NES run on TASK (CartPole-v0, Acrobot-v1 or another gymnasium id)."""
    from bilevel.agents import AGENTS
    from bilevel.errors import one_of
    from bilevel.hyperparameters import best_preset, load_preset
    from cluster.home import Home

    common = _Common(**options)
    task = common.the_task()
    if agent not in AGENTS:
        raise one_of("agent", agent, AGENTS)
    preset = preset or best_preset(task.id)
    hp = load_preset(preset, task.id, update)
    changes: dict[str, Any] = {
        "population_size": common.population,
        "generations": generations,
        "start_candidates": start_candidates,
    }
    changed = {key: value for key, value in changes.items() if value is not None}
    hp = replace(hp, nes=replace(hp.nes, **changed), vary_agent=vary_hp)
    if name is None:
        name = f"nes-{preset}-{update}{'-vary-hp' if vary_hp else ''}-seed{common.seed}"

    from cluster.nes_command import NESCommand, run_nes

    run_nes(
        NESCommand(
            task,
            hp,
            common.seed,
            name,
            Home(common.home),
            common.uri(),
            workers,
            common.address,
            solved_for,
        )
    )


@cli.command()
@_shared
@click.option("--study", default=None, help="Name; the same name goes on where it was.")
@click.option("--profile", default="local", show_default=True, help="smoke, local or paper.")
@click.option("--space", help="full (the paper's 18 hyperparameters) or core.")
@click.option("--brackets", type=click.IntRange(min=1), help="Brackets to run.")
@click.option("--time-budget", type=_Duration(), help="End after 90s, 45m, 2h, ...")
@click.option("--workers-per-trial", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--concurrent-trials", type=click.IntRange(min=1), help="Default: all cores' worth.")
@click.option("--dry-run", is_flag=True, help="Say what would be run, and run nothing.")
def bohb(
    study: str | None,
    profile: str,
    space: str | None,
    brackets: int | None,
    time_budget: float | None,
    workers_per_trial: int,
    concurrent_trials: int | None,
    dry_run: bool,
    **options: Any,
) -> None:
    """BOHB over NES runs on TASK: tune NES, SE and agent hyperparameters."""
    from bilevel.errors import one_of
    from cluster.home import Home
    from cluster.profiles import get_profile
    from search_spaces import SPACES

    common = _Common(**options)
    task = common.the_task()
    size = get_profile(profile)
    if space is not None and space not in SPACES:
        raise one_of("search space", space, SPACES)
    changes: dict[str, Any] = {
        "space": space,
        "population": common.population,
        "brackets": brackets,
        "time_budget": time_budget,
    }
    size = replace(size, **{key: value for key, value in changes.items() if value is not None})
    from cluster.bohb import study as studies
    from cluster.progress import Terminal

    settings = studies.StudySettings(
        task,
        study or f"bohb-{profile}-{size.space}-seed{common.seed}",
        profile,
        size,
        common.seed,
        Home(common.home),
        common.uri(),
        workers_per_trial,
        concurrent_trials,
        common.address,
    )
    assert settings.folder  # a bad name is told before anything starts
    if dry_run:
        studies.dry_run(settings, Terminal())
    else:
        sys.exit(studies.run_study(settings))


@cli.command()
@click.option("--home", type=click.Path(path_type=Path), default="runs", show_default=True)
@click.option("--host", default="127.0.0.1", show_default=True)
@click.option("--port", type=click.IntRange(1, 65535), default=5000, show_default=True)
def ui(home: Path, host: str, port: int) -> None:
    """The MLflow UI on the runs of the home folder, until Ctrl-C."""
    from cluster.home import Home
    from cluster.ui import serve_ui

    sys.exit(serve_ui(Home(home), host, port))


def main() -> None:
    """Entry point: an error of the user's is one line and exit code 2."""
    try:
        code = cli.main(standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except click.ClickException as error:
        _fail(error.format_message())
    except InvalidInput as error:
        _fail(str(error))
    except (KeyboardInterrupt, click.Abort):
        sys.exit(130)


def _fail(message: str) -> None:
    click.echo(f"bilevel: {' '.join(message.split())}", err=True)
    sys.exit(2)
