"""The end of a study: its recipe and its best SE are chosen and written."""

import time
from collections.abc import Callable, Iterator, Sequence

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.synthetic_env import save_se
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import Plan, least_search, validate
from cluster.bohb.study.definition import RECIPE_FILE, Study, configuration_name
from cluster.bohb.study.journal import Journal, ResultLine
from cluster.nes.run import Pool
from cluster.nes.selection import (
    RACERS,
    Contender,
    agents_needed,
    choose_best,
    evaluate_holdout,
    export_best,
    in_time,
    race,
)
from cluster.ray.pool import EvaluationPool
from cluster.session.hints import agent_options, task_options
from cluster.session.session import Session
from cluster.session.terminal import Terminal, count
from cluster.storage.run_folder import INCUMBENT_FILE
from cluster.tracking.registry import model_address


class Handover:
    """Chooses what a study hands over, and tells it."""

    def __init__(self, study: Study, journal: Journal, session: Session) -> None:
        self.study = study
        self.journal = journal
        self.session = session
        self.terminal = session.terminal

    def finish(self, pool: EvaluationPool, final_agents: int, is_over: Callable[[], bool]) -> bool:
        """Validate the best configurations, choose the best SE of all, and score it with fresh
        agents; return whether there is one. `is_over` tells whether the time is. Raises
        StorageFailure."""
        study, log = self.study, self.terminal.log
        self._validate(pool, is_over)
        incumbent = self._report_incumbent()
        every = list(all_runs(study, self.journal, pool, log))
        contenders = _contenders(every)
        if not contenders:
            log(self._nothing)
            return False
        if len(contenders) > 1:
            log(f"retesting the {len(contenders)} best SEs with fresh agents")
        before, rounds = pool.real_env_steps, race(final_agents)
        self.terminal.bar("retesting", 0, agents_needed(len(contenders), rounds), "tests")
        step, seed = self.terminal.step, (study.seed,)
        best = choose_best(study.task, contenders, seed, pool, step, in_time(rounds, is_over))
        score = evaluate_holdout(study.task, best, final_agents, seed, pool)
        learned = sum(state.real_env_steps for runs in every for state in runs.states)
        tests, number = pool.real_env_steps - before, len(self.journal.results)
        path, real_steps = export_best(best.se, score, study.folder, number, learned, tests)
        (study.folder / INCUMBENT_FILE).unlink(missing_ok=True)  # of an interruption before
        log(str(score))
        log(f"{real_steps} steps on the real task in all runs, the scale of observations included")
        if incumbent is not None:
            self._report_recipe()
        model = model_address(study.task.id, "newest")
        log(f"best SE: {path}  ({model} in MLflow's model registry)")
        log(f"results: {self.session.shown_at(self.session.identity.uuid)}")
        log("run the same command again to add brackets")
        return True

    @property
    def _nothing(self) -> str:
        """Why there is no SE."""
        results = self.journal.results
        if not results:
            return "no configuration finished a generation in this time"
        if any(line.exception is not None for line in results):
            return "no configuration finished a generation: see the errors above"
        return (
            f"no configuration got beyond the choice of its start in {results[-1].budget} core "
            "seconds: take a larger --profile, or a --space with fewer nes.start_candidates"
        )

    def interrupted(self) -> None:
        """Say what the interrupted search has found, and save its best SE. Raises
        StorageFailure."""
        incumbent = self._report_incumbent()
        if incumbent is None:
            return
        configuration = self._summary.configuration(incumbent.id)
        best = ConfigurationRuns.read(self.study, incumbent.id, configuration).best
        if best is not None and best.se.finite:
            path = self.study.folder / INCUMBENT_FILE
            save_se(best, path)
            self.terminal.log(f"its best SE, not retested: {path}")

    # -- the recipe --------------------------------------------------------------

    def _validate(self, pool: EvaluationPool, is_over: Callable[[], bool]) -> None:
        """Run the finalists with new seeds, and say what came of it."""
        log = self.terminal.log
        largest = self.study.schedule.budgets[-1]
        plan = Plan.of(self.journal, self._summary.validation, largest)
        if plan is None:
            if len(self.journal.reached) > 1 and self._summary.validation is None:
                searched = sum(self.journal.reached.values())
                log(
                    f"not validated with new seeds: the search took {searched:.0f} core seconds, "
                    f"and {least_search(largest):.0f} are needed"
                )
            return
        log(f"validating {len(plan.finalists)} configurations with new seeds")
        progress = _Progress(self.terminal)

        found = validate(self.study, self.journal, plan, pool, log, progress, is_over)
        if found is None:
            if is_over():
                log("the time was not enough for it; run the same command again to go on")
            return
        for finalist in found.finalists:
            before = self._summary.result_of(finalist.id)
            name, found_now = configuration_name(finalist.id), Tally.describe(finalist.info)
            log(
                f"{name} {found_now} with new seeds; objective {finalist.loss:.0f} (in the search "
                f"{before.loss:.0f})"
            )

    def _report_incumbent(self) -> ResultLine | None:
        """Write the incumbent's recipe and print it."""
        log, summary = self.terminal.log, self._summary
        log(
            f"{count(len(self.journal.results), 'result')} of "
            f"{count(len(self.journal.configs), 'configuration')} "
            f"({summary.model_based} proposed by the model)"
        )
        incumbent = summary.incumbent
        if incumbent is None:
            return None
        origin = ""
        if self._is_base(incumbent):
            what = "the nearest to the recipe" if self.study.moved else "the recipe"
            origin = f", {what}, which the search began with"
        log(
            f"incumbent {configuration_name(incumbent.id)}{origin}: "
            f"{Tally.describe(incumbent.info)}, objective {incumbent.loss:.0f}"
        )
        found = summary.configuration(incumbent.id)
        text = self.study.recipe_text(incumbent.id, found)
        write_aside(self.study.folder / RECIPE_FILE, text.encode())
        for name, value in found.items():
            log(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")
        return incumbent

    def _is_base(self, result: ResultLine) -> bool:
        return result.id == self.journal.recipe

    def _report_recipe(self) -> None:
        log, study = self.terminal.log, self.study
        options = f"{task_options(study.task)}{agent_options()}"
        call = self.session.home.hint(f"nes {study.task.id} --recipe {study.name}{options}")
        log(f"its recipe: {study.folder / RECIPE_FILE}; learn an SE by it with {call}")
        if len(self.journal.configs) > 1 and self._summary.validation is None:
            log(
                "the best of several configurations was also lucky: with other seeds, expect "
                "its recipe to take longer than its objective tells (docs/tuning.md)"
            )

    @property
    def _summary(self) -> StudySummary:
        return StudySummary.of(self.journal)


def all_runs(
    study: Study, journal: Journal, pool: Pool, log: Callable[[str], None]
) -> Iterator[ConfigurationRuns]:
    """The runs of every configuration, and those of its validation. A damaged or lost checkpoint is
    recomputed; a configuration for which that fails is left out, with a message. Raises
    StorageFailure, and OtherVersion."""
    reached = journal.reached
    failed = {line.id for line in journal.results if line.loss is None}
    for line in journal.configs:
        try:
            runs = ConfigurationRuns.open(study, line.id, line.configuration, log)
            runs.spend(reached.get(line.id, 0), pool)
            validated = ConfigurationRuns.read(study, line.id, line.configuration, True)
        except (StorageFailure, OtherVersion):
            raise
        except InvalidInput as error:
            if line.id not in failed:
                log(f"{configuration_name(line.id)} is left out: {error}")
            continue
        yield from (runs, validated)


class _Progress:
    """Shows how far a validation is. What an earlier process has spent tells nothing of the speed
    of this one."""

    def __init__(self, terminal: Terminal) -> None:
        self.terminal = terminal
        self.started = time.monotonic()
        self.first: float | None = None

    def __call__(self, spent: float, total: float) -> None:
        """Core seconds spent so far, and those of all finalists."""
        if self.first is None:
            self.first = spent
        done = spent - self.first
        seconds = (time.monotonic() - self.started) * (total - spent) / done if done else 0.0
        self.terminal.bar("validating", spent, total, "core s", eta=seconds)


def _contenders(every: Sequence[ConfigurationRuns]) -> list[Contender]:
    """The SEs of all runs that were confirmed, then those that scored highest in their own runs."""
    found = []
    for runs in every:
        hp = runs.run(0).hp
        for state in runs.states:
            ses = [state.best] if state.confirmed else state.candidates
            found += [
                ((state.confirmed, finalist.rank), Contender(se, hp))
                for finalist, se in zip(state.finalists, ses, strict=False)
            ]
    found.sort(key=lambda pair: pair[0], reverse=True)
    return [contender for _, contender in found[:RACERS]]
