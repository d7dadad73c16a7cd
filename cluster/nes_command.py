"""`bilevel nes`: one NES run on the cluster, tracked in MLflow."""

import time
from dataclasses import dataclass, field

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NESState
from bilevel.synthetic_env import save_se
from bilevel.tasks import Task
from cluster.final import LAST_FILE, Contender, choose_best, hand_over, score_anew
from cluster.home import Home, locked_settings
from cluster.nes_loop import NESRun
from cluster.pool import EvaluationPool, placed_pool
from cluster.progress import Terminal, duration, generation_line
from cluster.ray_cluster import cluster_cores, ray_cluster, require_capacity
from cluster.tracking import Tracker, plots
from cluster.tracking.tracker import check_tracking_uri, mlflow_imported_meanwhile

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


def run_nes(command: NESCommand) -> NESState:
    """Run (or continue) until solved and confirmed, or out of generations.

    Raises InvalidInput before anything is written; Ctrl-C loses at most the
    generation in flight.
    """
    folder = command.home.run_folder(command.task.id, command.name)
    check_tracking_uri(command.tracking_uri)
    with Terminal() as terminal, mlflow_imported_meanwhile(), ray_cluster(command.address):
        workers = command.workers or cluster_cores()
        require_capacity(workers)
        command.home.prepare()
        with placed_pool(workers) as pool:
            tracker = Tracker(command.tracking_uri, command.task.id, command.home.artifacts)
            with locked_settings(folder, command.settings()) as identity:
                run = NESRun(command.task, command.hp, command.seed, folder)
                return _LiveRun(command, run, pool, tracker, terminal).go(identity)


@dataclass
class _LiveRun:
    """A run while it runs: pool, tracker and terminal at hand."""

    command: NESCommand
    run: NESRun
    pool: EvaluationPool
    tracker: Tracker
    terminal: Terminal
    run_id: str = field(default="", init=False)  # in MLflow, once it is open

    def go(self, identity: str) -> NESState:
        """From what is on disk to the end, under the run `identity` in MLflow."""
        command, line = self.command, self.terminal.line
        nes = command.hp.nes
        loaded = self.run.load()
        self.run_id = self.tracker.open_run(
            identity,
            command.name,
            {**command.hp.to_dict(), "seed": command.seed, "task": command.task.id},
            {"bilevel.kind": "nes"},
            description=_description(command),
        )
        line(
            f"NES on {command.task.id}: population {nes.population_size}, update {nes.update}, at "
            f"most {nes.generations} generations, {self.pool.size} worker(s), seed {command.seed}"
        )
        line(f"folder {self.run.folder}; to look at it: {self.tracker.address}")
        if loaded is not None:
            line(f"going on after generation {loaded.generation - 1}")
        status = "KILLED"
        try:
            self.terminal.bar("choosing the start", 0, max(nes.start_evaluations, 1), "evaluations")
            state = loaded or self.run.open(self.pool, lambda result: self.terminal.step())
            state, best = self._generations(state)
            self._finish(state, best)
            status = "FINISHED"
            return state
        except KeyboardInterrupt:
            line("stopped; the same command goes on from the last finished generation")
            raise
        except Exception:
            status = "FAILED"
            raise
        finally:
            self.tracker.close_run(self.run_id, status)

    def _generations(self, state: NESState) -> tuple[NESState, Contender | None]:
        """Generation after generation; the second value is the SE that was confirmed
        to solve the task, None if the generations ended before."""
        limit, evaluations = self.command.hp.nes.generations, self.command.hp.nes.evaluations
        self.tracker.log_generations(self.run_id, state.records)
        started, first = time.monotonic(), state.generation
        while True:
            # Asked before each generation, so that a run that was killed asks again.
            due = state.solved_streak > 0 and state.solved_streak % self.command.solved_for == 0
            best = self._confirmed(state) if due else None
            if best is not None or state.generation >= limit:
                return state, best
            done = state.generation - first
            rate = (time.monotonic() - started) / max(done, 1)
            note = f"ETA at most {duration(rate * (limit - state.generation))}" if done else ""
            self.terminal.bar(f"generation {state.generation}", 0, evaluations, "evaluations", note)
            state = self.run.advance(state, self.pool, lambda result: self.terminal.step())
            self.tracker.log_generations(self.run_id, state.records[-1:])
            self.terminal.line(generation_line(state.records[-1], state.best_score))

    def _confirmed(self, state: NESState) -> Contender | None:
        """The best SE, if it still solves the task with agents nothing was chosen by.

        Scores that stop a run were lucky more often than not: they are the highest of
        many samples.
        """
        command, best = self.command, self._best(state)
        seed = (command.seed, state.generation)
        score = score_anew(command.task, best, CONFIRMING_AGENTS, seed, self.pool).scores.mean()
        solved = bool(score >= command.task.solved_reward)
        verdict = "solved" if solved else "not yet solved, going on"
        self.terminal.line(
            f"the best SE scores {score:.1f} with {CONFIRMING_AGENTS} others: {verdict}"
        )
        return best if solved else None

    def _best(self, state: NESState) -> Contender:
        contenders = [Contender(se, self.command.hp) for se in self.run.finalists(state)]
        self.terminal.line(f"retesting the {len(contenders)} best SEs with fresh agents")
        self.terminal.bar("retesting", 0, 1, "")
        seed = (self.command.seed, state.generation)
        return choose_best(self.command.task, contenders, seed, self.pool)

    def _finish(self, state: NESState, best: Contender | None) -> None:
        command, tracker, run_id, line = self.command, self.tracker, self.run_id, self.terminal.line
        reason = "all generations done" if best is None else "solved and stayed solved"
        seconds = duration(sum(record.generation_seconds for record in state.records))
        line(f"{reason}: {state.generation} generations in {seconds}")
        best = best or self._best(state)
        score = score_anew(command.task, best, FINAL_AGENTS, (command.seed,), self.pool)
        last = self.run.folder / LAST_FILE
        save_se(self.run.last_se(state), last)
        tracker.log_file(run_id, last)
        title = f"{command.name} on {command.task.id}"
        figure = plots.learning_curve(state.records, command.task, title)
        figure.savefig(self.run.folder / "learning_curve.png", dpi=150)
        tracker.log_figure(run_id, figure, "learning_curve.png")
        tracker.log_json(run_id, command.hp.to_dict(), "configuration.json")
        values = {"objective": state.objective, "budget": state.generation}
        tracker.log_metrics(run_id, values, state.generation)
        path, address = hand_over(best.se, score, self.run.folder, tracker, run_id)
        line(str(score))
        line(f"best SE: {path}  ({address} in MLflow's model registry)")
        line("look at the curves with `make ui`; use the SE with")
        line(
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
