"""`bilevel nes`: one NES run on the cluster, tracked in MLflow."""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

from bilevel.durable import write_aside
from bilevel.nes import GenerationRecord, NESState
from bilevel.nes.confirmation import FINAL_AGENTS, Confirming
from bilevel.nes.start import ChoosingStart
from bilevel.synthetic_env import save_se
from bilevel.tasks.task import MAX_SCALE_STEPS
from cluster.nes.pictures import learning_curve
from cluster.nes.run import NESRun, start_of
from cluster.nes.selection import (
    RETEST,
    Contender,
    agents_needed,
    choose_best,
    evaluate_holdout,
    export_best,
)
from cluster.nes.view import CURVE_FILE, NESViews
from cluster.pictures import image
from cluster.ray.pool import EvaluationPool
from cluster.session.context import Driver, RunContext, Session
from cluster.session.terminal import Terminal, count, duration
from cluster.storage.run_folder import LAST_FILE
from cluster.tracking import Point
from cluster.tracking.registry import model_address


def run_nes(run: NESRun, context: RunContext, workers: int | None = None) -> None:
    """Run or resume until the SE is confirmed or generations run out, by default with one worker
    per core of the cluster.

    Raises InvalidInput before anything is written, and StorageFailure if the disk is full.
    Ctrl-C loses at most the current generation.
    """
    with context.connected(workers or 1) as driver, EvaluationPool(workers) as pool:
        run_on(run, driver, pool)


def run_on(run: NESRun, driver: Driver, pool: EvaluationPool) -> None:
    """Do the same over an existing connection and pool, so that runs can follow one another."""
    with driver.session(run.folder, run.task.id, run.settings()) as session:
        _Runner(run, session, driver.terminal, pool).run_to_the_end()


@dataclass(frozen=True)
class _Runner:
    run: NESRun
    session: Session
    terminal: Terminal
    pool: EvaluationPool

    def run_to_the_end(self) -> None:
        """Run from the last checkpoint to the end."""
        run, nes = self.run, self.run.hp.nes
        self.session.introduce(
            f"NES on {run.task.id}: recipe {run.hp.recipe}, {start_of(nes)}, rule {nes.update}, "
            f"SE family {run.hp.se.family}, population {nes.population_size}, at most "
            f"{nes.generations} generations, {count(self.pool.size, 'worker')}, seed {run.seed}"
        )
        views = NESViews(run.folder, live=True)
        resume_hint = "run the same command again to resume after the last finished generation"
        with self.session.live(views, nes.generations, resume_hint) as mirror:
            state = run.open(self.terminal.log, self._scale_bar())
            if state.generation > 0:
                self.terminal.log(f"resuming after generation {state.generation - 1}")
            while not state.finished:
                self.session.guard.check()
                before, state = state, self._advance(state)
                if state.generation > before.generation:
                    mirror.append(self.session.identity.uuid, [Point.of(state.records[-1])])
            self._finish(state)

    def _scale_bar(self) -> Callable[[], None]:
        """Return a function that shows each step of measuring the scale of observations."""
        steps, started, log = itertools.count(1), time.monotonic(), self.terminal.log
        if not self.run.task.compiled and not self.run.state_file.exists():
            log(f"measuring the scale of observations in at most {MAX_SCALE_STEPS} random steps")

        def show() -> None:
            step = next(steps)
            rate = step / max(time.monotonic() - started, 1e-9)
            left = duration((MAX_SCALE_STEPS - step) / rate)
            note = f"{rate:.0f} per second, at most {left} left"
            self.terminal.bar("measuring the scale", step, MAX_SCALE_STEPS, "steps", note)

        return show

    def _advance(self, state: NESState) -> NESState:
        """Run a generation, or a round of another phase, and log its result."""
        nes, log = self.run.hp.nes, self.terminal.log
        match state.phase:
            case ChoosingStart(halving, draws):
                if halving.round == 0:
                    others = "other " if draws > 1 else ""
                    log(f"choosing a start among {len(halving.left)} {others}random SEs")
                self.terminal.bar("choosing the start", 0, halving.evaluations, "evaluations")
            case Confirming() as confirming:
                begun = confirming.coming.start
                self.terminal.bar("confirming", begun, confirming.agents, "agents")
            case _:
                title, note = f"generation {state.generation}", ""
                if state.records:
                    left = nes.generations - state.generation
                    note = f"at most {duration(left * state.records[-1].generation_seconds)} left"
                self.terminal.bar(title, 0, nes.evaluations, "evaluations", note)
        after = self.run.advance(state, self.pool, lambda result: self.terminal.step())
        if after.generation > state.generation:
            log(generation_line(after.records[-1], after.best_score))
        if isinstance(state.phase, Confirming) and not isinstance(after.phase, Confirming):
            verdict = "confirmed" if after.confirmed else "not confirmed, continuing"
            log(f"fresh agents trained on the current SE: {verdict}")
        if after.attempt > state.attempt:
            log(
                f"no new best SE for {nes.restart_after} generations: attempt "
                f"{after.attempt + 1} starts from other random SEs"
            )
        return after

    def _finish(self, state: NESState) -> None:
        """Score the confirmed SE, or the best one of a retest, with fresh agents."""
        run, nes, log = self.run, self.run.nes, self.terminal.log
        reason = "all generations done"
        if state.confirmed:
            reason = "solved and confirmed"
        elif state.solved(run.hp.nes, run.task.solved_reward):
            reason = "solved"
        elapsed = duration(time.monotonic() - self.terminal.started)
        log(f"{reason}: {count(state.generation, 'generation')} in {elapsed}")
        steps_before = self.pool.real_env_steps
        if state.confirmed:
            best = Contender(nes.best(state), run.hp)
        else:
            ses = nes.current(state), *nes.candidates(state)
            log(f"retesting the {len(ses)} best SEs with fresh agents")
            self.terminal.bar("retesting", 0, agents_needed(len(ses), RETEST), "tests")
            contenders, seed = [Contender(se, run.hp) for se in ses], (run.seed, state.generation)
            best = choose_best(run.task, contenders, seed, self.pool, self.terminal.step)
        score = evaluate_holdout(run.task, best, FINAL_AGENTS, (run.seed,), self.pool)
        tests = self.pool.real_env_steps - steps_before
        last, last_file = nes.current(state), run.folder / LAST_FILE
        last_file.unlink(missing_ok=True)
        if last.se.finite:
            save_se(last, last_file)
        figure = learning_curve(state.records, run.task, f"{run.folder.name} on {run.task.id}")
        write_aside(run.folder / CURVE_FILE, image(figure))
        path, real_steps = export_best(
            best.se, score, run.folder, state.generation, state.real_env_steps, tests
        )
        log(str(score))
        log(f"{real_steps} steps on the real task, including the scale of observations")
        model = model_address(run.task.id, "newest")
        log(f"best SE: {path}  ({model} in MLflow's model registry)")
        log(f"learning curve: {self.session.address}")
        log(f'use the SE with `gymnasium.make("bilevel/SyntheticEnv-v0", path="{path}")`')


def generation_line(record: GenerationRecord, best: float) -> str:
    """Summarise a generation in one line of 80 columns."""
    return f"{record}  best {best:7.1f}  {record.generation_seconds:5.1f}s"
