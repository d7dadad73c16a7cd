"""`bilevel nes`: one NES run on the cluster, tracked in MLflow."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ray.util.placement_group import placement_group, remove_placement_group
from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NESState
from bilevel.synthetic_env import save_se
from bilevel.tasks import Task
from cluster.final import LAST_FILE, Contender, choose_best, hand_over, score_anew
from cluster.home import Home, locked_settings
from cluster.nes_loop import NESRun
from cluster.pool import EvaluationPool
from cluster.progress import Terminal, duration, generation_line
from cluster.ray_cluster import cluster_cores, ray_cluster, require_capacity
from cluster.tracking import Tracker, plots
from cluster.tracking.tracker import check_tracking_uri

#: Fresh agents that must solve the task on average for a run to stop early, and
#: those that score the best SE at the end, with seeds of their own.
CONFIRMING_AGENTS, FINAL_AGENTS = 32, 10


@dataclass(frozen=True)
class NESCommand:
    """Settings of one NES run besides its hyperparameters.

    `solved_for`: generations in a row that must solve the task before the best SE is
    tested by agents nothing was chosen by; if these solve it too, the run stops.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    name: str
    home: Home
    tracking_uri: str
    workers: int | None = None  # actors; None: one a core of the cluster
    address: str | None = None
    solved_for: int = 5

    def settings(self) -> dict[str, object]:
        """What must stay the same when the run is continued. The number of
        generations may grow, the number of workers is free."""
        hp = self.hp.to_dict()
        del hp["nes"]["generations"]
        return {"task": self.task.id, "seed": self.seed, **hp}


@contextmanager
def placed_pool(workers: int) -> Iterator[EvaluationPool]:
    """A pool in a placement group of its own; both are gone afterwards."""
    group = placement_group([{"CPU": 1}] * workers, strategy="PACK")
    try:
        strategy = PlacementGroupSchedulingStrategy(group)
        with EvaluationPool(workers, scheduling_strategy=strategy) as pool:
            yield pool
    finally:
        remove_placement_group(group)


def run_nes(command: NESCommand) -> NESState:
    """Run (or continue) until solved and stayed solved, or out of generations.

    Raises InvalidInput before anything is written; Ctrl-C loses at most the
    generation in flight.
    """
    folder = command.home.run_folder(command.task.id, command.name)
    check_tracking_uri(command.tracking_uri)
    with Terminal() as terminal, ray_cluster(command.address):
        workers = command.workers or cluster_cores()
        require_capacity(workers)
        command.home.prepare()
        with placed_pool(workers) as pool:
            tracker = Tracker(command.tracking_uri, command.task.id, command.home.artifacts)
            with locked_settings(folder, command.settings()) as identity:
                return _run(command, folder, identity, pool, tracker, terminal)


def _run(
    command: NESCommand,
    folder: Path,
    identity: str,
    pool: EvaluationPool,
    tracker: Tracker,
    terminal: Terminal,
) -> NESState:
    task, hp = command.task, command.hp
    run = NESRun(task, hp, command.seed, folder)
    loaded = run.load()
    run_id = tracker.open_run(
        identity,
        command.name,
        {**hp.to_dict(), "seed": command.seed, "task": task.id},
        {"bilevel.kind": "nes"},
        description=_description(command),
    )
    terminal.line(
        f"NES on {task.id}: population {hp.nes.population_size}, update {hp.nes.update}, "
        f"at most {hp.nes.generations} generations, {pool.size} worker(s), "
        f"seed {command.seed}"
    )
    terminal.line(f"folder {folder}; to look at it: {tracker.address}")
    if loaded is not None:
        terminal.line(f"going on after generation {loaded.generation - 1}")
    status = "KILLED"
    try:
        started = time.monotonic()
        terminal.bar("choosing the start", 0, max(hp.nes.start_evaluations, 1), "evaluations")
        state = loaded or run.open(pool, lambda result: terminal.step())
        tracker.log_generations(run_id, state.records)
        first = state.generation
        while True:
            # Asked before each generation, so that a run that was killed asks again.
            due = state.solved_streak > 0 and state.solved_streak % command.solved_for == 0
            best = _confirmed(command, run, state, pool, terminal) if due else None
            if best is not None or state.generation >= hp.nes.generations:
                break
            left = hp.nes.generations - state.generation
            rate = (time.monotonic() - started) / max(state.generation - first, 1)
            note = f"ETA at most {duration(rate * left)}" if state.generation > first else ""
            terminal.bar(
                f"generation {state.generation}", 0, hp.nes.evaluations, "evaluations", note
            )
            state = run.advance(state, pool, lambda result: terminal.step())
            tracker.log_generations(run_id, state.records[-1:])
            terminal.line(generation_line(state.records[-1], state.best_score))
        _finish(command, run, state, best, pool, tracker, run_id, terminal)
        status = "FINISHED"
        return state
    except KeyboardInterrupt:
        terminal.line("stopped; the same command goes on from the last finished generation")
        raise
    except Exception:
        status = "FAILED"
        raise
    finally:
        tracker.close_run(run_id, status)


def _confirmed(
    command: NESCommand, run: NESRun, state: NESState, pool: EvaluationPool, terminal: Terminal
) -> Contender | None:
    """The best SE, if it still solves the task with agents nothing was chosen by.

    Scores that stop a run were lucky more often than not: they are the highest of
    many samples.
    """
    best = _best(command, run, state, pool, terminal)
    seed = (command.seed, state.generation)
    score = score_anew(command.task, best, CONFIRMING_AGENTS, seed, pool).scores.mean()
    solved = bool(score >= command.task.solved_reward)
    verdict = "solved" if solved else "not yet solved, going on"
    terminal.line(f"the best SE scores {score:.1f} with {CONFIRMING_AGENTS} others: {verdict}")
    return best if solved else None


def _best(
    command: NESCommand, run: NESRun, state: NESState, pool: EvaluationPool, terminal: Terminal
) -> Contender:
    contenders = [Contender(se, command.hp) for se in run.finalists(state)]
    terminal.line(f"retesting the {len(contenders)} best SEs with fresh agents")
    terminal.bar("retesting", 0, 1, "")
    return choose_best(command.task, contenders, (command.seed, state.generation), pool)


def _finish(
    command: NESCommand,
    run: NESRun,
    state: NESState,
    best: Contender | None,
    pool: EvaluationPool,
    tracker: Tracker,
    run_id: str,
    terminal: Terminal,
) -> None:
    reason = "all generations done" if best is None else "solved and stayed solved"
    seconds = duration(sum(record.generation_seconds for record in state.records))
    terminal.line(f"{reason}: {state.generation} generations in {seconds}")
    best = best or _best(command, run, state, pool, terminal)
    score = score_anew(command.task, best, FINAL_AGENTS, (command.seed,), pool)
    last = run.folder / LAST_FILE
    save_se(run.last_se(state), last)
    tracker.log_file(run_id, last)
    title = f"{command.name} on {command.task.id}"
    figure = plots.learning_curve(state.records, command.task, title)
    tracker.log_figure(run_id, figure, "learning_curve.png")
    tracker.log_json(run_id, command.hp.to_dict(), "configuration.json")
    figure.savefig(run.folder / "learning_curve.png", dpi=150)
    tracker.log_metrics(
        run_id, {"objective": state.objective, "budget": state.generation}, state.generation
    )
    path, address = hand_over(best.se, score, run.folder, tracker, run_id)
    terminal.line(str(score))
    terminal.line(f"best SE: {path}  ({address} in MLflow's model registry)")
    terminal.line("look at the curves with `make ui`; use the SE with")
    terminal.line(
        f'  import bilevel, gymnasium; gymnasium.make("bilevel/SyntheticEnv-v0", path="{path}")'
    )


def _description(command: NESCommand) -> str:
    nes = command.hp.nes
    return (
        f"One NES run on **{command.task.id}** ({nes.update} update, population "
        f"{nes.population_size}, step size {nes.step_size:g}, std. dev. {nes.std_dev:g}, seed "
        f"{command.seed}). Per generation: `score_*`, `train_*` and `solved_fraction` are of "
        "agents trained on the unperturbed SE. It stops once the task has been solved for "
        f"{command.solved_for} generations in a row and {CONFIRMING_AGENTS} fresh agents confirm "
        f"it, or after {nes.generations} generations; "
        "`final_*` are of fresh agents trained on the best SE."
    )
