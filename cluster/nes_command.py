"""`bilevel nes`: one NES run on the cluster, tracked in MLflow."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from bilevel.durable import write_aside
from bilevel.nes import NESState
from bilevel.synthetic_env import save_se
from cluster.final import (
    LAST_FILE,
    Contender,
    choose_best,
    confirm,
    hand_over,
    score_anew,
)
from cluster.interrupts import InterruptGuard
from cluster.live_run import live_run
from cluster.nes_loop import NESRun, start_of
from cluster.place import Place
from cluster.pool import EvaluationPool
from cluster.progress import Terminal, count, duration, generation_line
from cluster.run_folder import Begun, locked_settings
from cluster.tracking import Tracker
from cluster.tracking.registry import model_address
from cluster.views import NESViews, plots

#: Fresh agents that must surely solve the task for a run to stop early, and those that score the
#: best SE at the end, with seeds of their own.
CONFIRMING_AGENTS, FINAL_AGENTS = 16, 10


@dataclass(frozen=True)
class NESCommand:
    """An NES run, and how and where it is run this time.

    Once the run is solved (`nes.solved_for`), agents nothing was chosen by are trained on its
    current SE; if these solve the task too, the run stops and hands it over.
    """

    run: NESRun
    place: Place
    workers: int | None = None  # actors; None: one a core of the cluster


def run_nes(command: NESCommand) -> NESState:
    """Run (or continue) until solved and confirmed, or out of generations.

    Raises InvalidInput before anything is written, and StorageFailure when there is
    no room any more; Ctrl-C loses at most the generation in flight.
    """
    run = command.run
    with (
        command.place.entered() as terminal,
        InterruptGuard(terminal) as guard,  # after Ray, which takes SIGTERM for itself
        EvaluationPool.on_cluster(command.workers) as pool,
    ):
        tracker = command.place.tracker(run.task.id)
        with locked_settings(run.folder, run.settings()) as begun:
            return _UnderWay(command, run, begun, pool, tracker, terminal, guard).go()


@dataclass
class _UnderWay:
    """A run under way: pool, tracker and terminal at hand."""

    command: NESCommand
    run: NESRun
    begun: Begun
    pool: EvaluationPool
    tracker: Tracker
    terminal: Terminal
    guard: InterruptGuard

    def go(self) -> NESState:
        """From what is on disk to the end."""
        self._introduce()
        run = self.run
        views = NESViews(run, self.begun, live=True)
        target = run.hp.nes.generations
        try:
            with live_run(run.folder, target, views, self.tracker, self.terminal) as live:
                state, best = self._generations(
                    self._open(), lambda: live.mirror.mark(views.keys())
                )
                self._finish(state, best)
                return state
        except KeyboardInterrupt:
            self.terminal.line(
                "stopped; the same command goes on from the last finished generation"
            )
            raise

    def _introduce(self) -> None:
        run, line = self.run, self.terminal.line
        nes = run.hp.nes
        line(
            f"NES on {run.task.id}: recipe {run.hp.recipe}, {start_of(nes)}, rule {nes.update}, "
            f"SE structure {run.hp.se.structure}, population {nes.population_size}, at most "
            f"{nes.generations} generations, {self.pool.size} worker(s), seed {run.seed}"
        )
        line(f"folder {run.folder}; to look at it: {self.tracker.address}")

    def _open(self) -> NESState:
        if self.run.hp.nes.start == "distilled":
            self.terminal.line("distilling the start from action values of the real task")
        state = self.run.open(self.terminal.line)
        if state.generation > 0:
            self.terminal.line(f"going on after generation {state.generation - 1}")
        return state

    def _chosen(self, state: NESState) -> NESState:
        """The state once the start of this attempt is chosen."""
        if state.race is None:
            return state
        if state.attempt:
            self.terminal.line(
                f"no new best SE for {self.run.hp.nes.restart_after} generations: attempt "
                f"{state.attempt + 1} begins from other random SEs"
            )
        self.terminal.line(f"choosing a start among {state.race.candidates} random SEs")
        self.terminal.bar("choosing the start", 0, state.race.evaluations, "evaluations")
        while not state.started:
            self.guard.check()
            state = self.run.advance(state, self.pool, lambda result: self.terminal.step())
        return state

    def _generations(
        self, state: NESState, changed: Callable[[], None]
    ) -> tuple[NESState, Contender | None]:
        """Generation after generation; the second value is the SE that was confirmed
        to solve the task, None if the generations ended before."""
        nes = self.run.hp.nes
        started, first = time.monotonic(), state.generation
        while True:
            self.guard.check()
            state = self._chosen(state)
            # Asked before each generation, so that a run that was killed asks again.
            best = None
            if state.solved_for_long(nes):
                before = self.pool.real_env_steps
                best = self._confirmed(state)
                real_steps = state.real_env_steps + self.pool.real_env_steps - before
                state = replace(state, real_env_steps=real_steps)
            if best is not None or state.generation >= nes.generations:
                return state, best
            done = state.generation - first
            rate = (time.monotonic() - started) / max(done, 1)
            left = nes.generations - state.generation
            note = f"ETA at most {duration(rate * left)}" if done else ""
            self.terminal.bar(
                f"generation {state.generation}", 0, nes.evaluations, "evaluations", note
            )
            state = self.run.advance(state, self.pool, lambda result: self.terminal.step())
            changed()
            self.terminal.line(generation_line(state.records[-1], state.best_score))

    def _confirmed(self, state: NESState) -> Contender | None:
        """The current SE, if agents of all sizes, which nothing was chosen by, solve the task.

        Scores that stop a run were lucky more often than not: they are the highest of
        many samples.
        """
        run = self.run
        current = Contender(state.current, run.hp)
        self.terminal.bar("confirming", 0, 1, "")
        score = confirm(
            run.task, current, CONFIRMING_AGENTS, (run.seed, state.generation), self.pool
        )
        solved = score.surely_solved
        verdict = "solved" if solved else "not surely solved yet, going on"
        self.terminal.line(
            f"{score.scores.size} fresh agents of all sizes score {score.scores.mean():.1f} ± "
            f"{score.scores.std():.1f}: {verdict}"
        )
        return current if solved else None

    def _best(self, state: NESState) -> Contender:
        ses = [state.current, *state.candidates]
        contenders = [Contender(se, self.run.hp) for se in ses]
        self.terminal.line(f"retesting the {len(contenders)} best SEs with fresh agents")
        self.terminal.bar("retesting", 0, 1, "")
        seed = (self.run.seed, state.generation)
        return choose_best(self.run.task, contenders, seed, self.pool)

    def _finish(self, state: NESState, best: Contender | None) -> None:
        run, line = self.run, self.terminal.line
        reason = "all generations done" if best is None else "solved and stayed solved"
        seconds = duration(sum(record.generation_seconds for record in state.records))
        line(f"{reason}: {count(state.generation, 'generation')} in {seconds}")
        before = self.pool.real_env_steps
        best = best or self._best(state)
        score = score_anew(run.task, best, FINAL_AGENTS, (run.seed,), self.pool)
        real_steps = state.real_env_steps + self.pool.real_env_steps - before
        line(f"{real_steps} steps on the real task, nearly all of them in tests")
        se = replace(best.se, info={**best.se.info, "real_env_steps": real_steps})
        save_se(state.current, run.folder / LAST_FILE)
        title = f"{run.folder.name} on {run.task.id}"
        figure = plots.learning_curve(state.records, run.task, title)
        write_aside(run.folder / "learning_curve.png", plots.png(figure))
        path = hand_over(se, score, run.folder, state.generation)
        line(str(score))
        line(f"best SE: {path}  ({model_address(run.task.id)} in MLflow's model registry)")
        line("look at the curves with `make ui`; use the SE with")
        line(
            f'  import bilevel, gymnasium; gymnasium.make("bilevel/SyntheticEnv-v0", path="{path}")'
        )
