"""`bilevel nes`: one NES run on the cluster, tracked in MLflow."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from bilevel.durable import write_aside
from bilevel.evaluation import EvaluationResult, scores_of
from bilevel.nes import GenerationRecord, NESState
from bilevel.nes.confirmation import FINAL_AGENTS, Confirmation, solving_share
from bilevel.nes.start import StartRace
from bilevel.synthetic_env import save_se
from cluster.nes import pictures
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
from cluster.pictures import png
from cluster.ray.pool import EvaluationPool
from cluster.session.context import Driver, RunContext
from cluster.session.session import Session
from cluster.session.terminal import count, duration
from cluster.storage.run_folder import LAST_FILE
from cluster.tracking import Point
from cluster.tracking.registry import model_address

#: Steps of an average episode below which the terminal says that agents see little in it.
_SHORT = 3.0


@dataclass(frozen=True)
class NESCommand:
    """An NES run, and how and where this command runs it."""

    run: NESRun
    context: RunContext
    workers: int | None = None  # actors; None: one per core of this run's share


def run_nes(command: NESCommand) -> NESState:
    """Run or resume until solved and confirmed, or out of generations; return the last state.

    Raises InvalidInput before anything is written, and StorageFailure if the disk is full.
    Ctrl-C loses at most the generation in flight.
    """
    with (
        command.context.connected(command.workers or 1) as driver,
        EvaluationPool.on_cluster(command.workers) as pool,
    ):
        return run_on(command.run, driver, pool)


def run_on(run: NESRun, driver: Driver, pool: EvaluationPool) -> NESState:
    """`run_nes` over a connection and a pool that are there already: several runs may follow one
    another."""
    with driver.session(run.folder, run.task.id, run.settings()) as session:
        return _Runner(run, session, pool).run_to_the_end()


class _Runner:
    """Runs NES from the last checkpoint to the end."""

    def __init__(self, run: NESRun, session: Session, pool: EvaluationPool) -> None:
        self.run = run
        self.session = session
        self.terminal = session.terminal
        self.pool = pool

    def run_to_the_end(self) -> NESState:
        """Run from the last checkpoint to the end."""
        run, nes = self.run, self.run.hp.nes
        self.session.introduce(
            f"NES on {run.task.id}: recipe {run.hp.recipe}, {start_of(nes)}, rule {nes.update}, "
            f"SE structure {run.hp.se.structure}, population {nes.population_size}, at most "
            f"{nes.generations} generations, {count(self.pool.size, 'worker')}, seed {run.seed}"
        )
        views = NESViews(run, self.session.identity, live=True)
        resume_hint = "run the same command again to resume after the last finished generation"
        with self.session.live(views, nes.generations, resume_hint) as mirror:
            key = self.session.identity.uuid
            state = self._run_generations(
                self._open(), lambda record: mirror.append(key, [Point.of(record)])
            )
            self._finish(state)
            return state

    def _open(self) -> NESState:
        if self.run.hp.nes.start == "distilled":
            self.terminal.log("distilling the start from action values of the real task")
        state = self.run.open(self.terminal.log)
        if state.generation > 0:
            self.terminal.log(f"resuming after generation {state.generation - 1}")
        return state

    def _run_generations(
        self, state: NESState, track: Callable[[GenerationRecord], None]
    ) -> NESState:
        """Run start, generations and confirmations until the state is finished."""
        nes = self.run.hp.nes
        started, first = time.monotonic(), state.generation
        while not state.finished:
            self.session.guard.check()
            if state.race is not None:
                state = self._choose_start(state, state.race)
            elif state.confirmation is not None:
                state = self._confirm(state, state.confirmation)
            else:
                done, left = state.generation - first, nes.generations - state.generation
                seconds = (time.monotonic() - started) / max(done, 1) * left
                note = f"at most {duration(seconds)} to the last one" if done else ""
                title = f"generation {state.generation}"
                self.terminal.bar(title, 0, nes.evaluations, "evaluations", note)
                state = self._advance(state)
                record = state.records[-1]
                track(record)
                self.terminal.log(generation_line(record, state.best_score))
                if told := of_short_episodes(record):
                    self.terminal.log(told)
        return state

    def _advance(
        self, state: NESState, on_result: Callable[[EvaluationResult], None] | None = None
    ) -> NESState:
        def count_one(result: EvaluationResult) -> None:
            self.terminal.step()
            if on_result is not None:
                on_result(result)

        return self.run.advance(state, self.pool, count_one)

    def _choose_start(self, state: NESState, race: StartRace) -> NESState:
        """Choose the start of this attempt."""
        if state.attempt:
            self.terminal.log(
                f"no new best SE for {self.run.hp.nes.restart_after} generations: attempt "
                f"{state.attempt + 1} starts from other random SEs"
            )
        self.terminal.log(f"choosing a start among {race.candidates} random SEs")
        self.terminal.bar("choosing the start", 0, race.evaluations, "evaluations")
        while not state.started:
            self.session.guard.check()
            state = self._advance(state)
        return state

    def _confirm(self, state: NESState, confirmation: Confirmation) -> NESState:
        """Train the agents of one round of a confirmation, and log its result."""
        begun = confirmation.coming.start
        self.terminal.bar("confirming", begun, confirmation.agents, "agents")
        results: list[EvaluationResult] = []
        state = self._advance(state, results.append)
        if state.confirmation is None:
            found = confirmation.after(scores_of(results).tolist()).all_scores
            share = solving_share(found, self.run.task.solved_reward)
            verdict = "confirmed" if state.confirmed else "not confirmed, going on"
            self.terminal.log(
                f"{found.size} fresh agents score {found.mean():.1f} ± {found.std():.1f} on the "
                f"current SE; the mean of {FINAL_AGENTS} drawn from them solves the task with "
                f"a chance of {share:.0%} ({confirmation.required:.0%} needed): {verdict}"
            )
        return state

    def _best(self, state: NESState) -> Contender:
        ses = [state.current, *state.candidates]
        contenders = [Contender(se, self.run.hp) for se in ses]
        self.terminal.log(f"retesting the {len(contenders)} best SEs with fresh agents")
        self.terminal.bar("retesting", 0, agents_needed(len(contenders), RETEST), "tests")
        seed = (self.run.seed, state.generation)
        return choose_best(self.run.task, contenders, seed, self.pool, self.terminal.step)

    def _finish(self, state: NESState) -> None:
        run, log = self.run, self.terminal.log
        reason = "all generations done"
        if run.hp.nes.confirming_agents:
            reason += ", no SE confirmed"
        if state.confirmed:
            reason = "solved and confirmed"
        elif state.solved_for_long(run.hp.nes):
            reason = "solved"
        elapsed = duration(time.monotonic() - self.terminal.started)
        log(f"{reason}: {count(state.generation, 'generation')}, {elapsed} after the command began")
        before = self.pool.real_env_steps
        best = Contender(state.best, run.hp) if state.confirmed else self._best(state)
        score = evaluate_holdout(run.task, best, FINAL_AGENTS, (run.seed,), self.pool)
        tests = self.pool.real_env_steps - before
        if state.current.se.finite:
            save_se(state.current, run.folder / LAST_FILE)
        else:
            (run.folder / LAST_FILE).unlink(missing_ok=True)  # of an earlier end
            log("the last SE is not kept: its parameters are not finite (the best SE is)")
        title = f"{run.folder.name} on {run.task.id}"
        figure = pictures.learning_curve(state.records, run.task, title)
        write_aside(run.folder / CURVE_FILE, png(figure))
        path, real_steps = export_best(
            best.se, score, run.folder, state.generation, state.real_env_steps, tests
        )
        log(f"{real_steps} steps on the real task, the scale of observations included")
        log(str(score))
        model = model_address(run.task.id, "newest")
        log(f"best SE: {path}  ({model} in MLflow's model registry)")
        log(f"learning curve: {self.session.shown_at(self.session.identity.uuid)}")
        modules = "bilevel", "gymnasium", run.task.id.rpartition(":")[0]
        log("load the SE with")
        log(
            f"  import {', '.join(filter(None, modules))}; "
            f'gymnasium.make("bilevel/SyntheticEnv-v0", path="{path}")'
        )


def of_short_episodes(record: GenerationRecord) -> str | None:
    """What is told after a first generation on an SE whose episodes end as soon as they begin; None
    of any other."""
    if record.generation or not record.episode_length < _SHORT:
        return None
    return (
        f"episodes on the SE last {record.episode_length:.1f} steps on average: agents see little "
        "but the task's initial states (docs/other-tasks.md)"
    )


def generation_line(record: GenerationRecord, best: float) -> str:
    """Summary of a generation in one line of 80 columns."""
    scores, train_steps = record.in_words()
    return f"{scores}  best {best:7.1f}  {train_steps}  {record.generation_seconds:5.1f}s"
