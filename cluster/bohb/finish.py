"""The end of a study: validate its best configurations, and export the recipe and the best SE."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.nes.halving import Round
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import Plan, Validation, validate
from cluster.bohb.study.definition import RECIPE_FILE, Study, configuration_name
from cluster.bohb.study.journal import Journal
from cluster.nes.run import Pool
from cluster.nes.selection import (
    RACERS,
    Contender,
    agents_needed,
    choose_best,
    evaluate_holdout,
    export_best,
    race,
)
from cluster.ray.pool import EvaluationPool
from cluster.session.session import Session
from cluster.session.terminal import count
from cluster.tracking.registry import model_address


@dataclass(frozen=True)
class StudyEnd:
    """Exports the results of a study and reports them in the terminal."""

    study: Study
    journal: Journal
    session: Session

    def finish(self, pool: EvaluationPool, final_agents: int, is_over: Callable[[], bool]) -> bool:
        """Validate the best configurations until `is_over`, choose the best SE of all runs, and
        score it with fresh agents; return whether there is one. Raises StorageFailure."""
        study, log = self.study, self.session.terminal.log
        self._validate(pool, is_over)
        exported = self.export_recipe()
        configurations = list(all_runs(study, self.journal, pool, log))
        contenders = contenders_of(configurations)
        if not contenders:
            log(
                "no configuration finished a generation: see the errors above, or use more time, "
                "a larger --profile, or a --space with fewer nes.start_candidates"
            )
            return False
        before, seed = pool.real_env_steps, (study.seed,)
        best = self._retest(contenders, pool, race(final_agents), is_over)
        score = evaluate_holdout(study.task, best, final_agents, seed, pool)
        tests = pool.real_env_steps - before
        states = [state for runs in configurations for state in runs.states]
        learned = sum(state.real_env_steps for state in states)
        step = len(self.journal.results)
        path, real_steps = export_best(best.se, score, study.folder, step, learned, tests)
        log(str(score))
        log(f"{real_steps} steps on the real task in all runs, the scale of observations included")
        if exported:
            call = self.session.home.hint(f"nes {study.task.id} --recipe {study.name}")
            log(f"its recipe: {study.folder / RECIPE_FILE}; learn an SE with it by {call}")
        model = model_address(study.task.id, "newest")
        log(f"best SE: {path}  ({model} in MLflow's model registry)")
        log(f"results: {self.session.shown_at(self.session.identity.uuid)}")
        log("run the same command again to add brackets")
        return True

    def export_recipe(self) -> bool:
        """Report the incumbent and write its recipe; return whether there is one. Raises
        StorageFailure."""
        log, journal = self.session.terminal.log, self.journal
        summary = StudySummary.of(journal)
        log(
            f"{count(len(journal.results), 'result')} of "
            f"{count(len(journal.configs), 'configuration')} "
            f"({summary.model_based} proposed by the model)"
        )
        incumbent = summary.incumbent
        if incumbent is None:
            return False
        proposal = journal.proposals[incumbent.id]
        log(
            f"incumbent {configuration_name(incumbent.id)} ({proposal.origin}): "
            f"{Tally.describe(incumbent.info)}, objective {incumbent.objective:.0f}"
        )
        text = self.study.recipe_text(incumbent.id, proposal.configuration)
        write_aside(self.study.folder / RECIPE_FILE, text.encode())
        for name, value in proposal.configuration.items():
            log(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")
        return True

    def _validate(self, pool: EvaluationPool, is_over: Callable[[], bool]) -> None:
        terminal, before = self.session.terminal, Validation.load(self.study.folder)
        plan = Plan.of(self.journal, before, self.study.schedule.budgets[-1])
        if plan is None and before is None:
            terminal.log(
                "the search is too short for a validation with new seeds: expect the recipe to "
                "take longer than its objective (docs/tuning.md)"
            )
        if plan is None:
            return
        terminal.log(f"validating {len(plan.finalists)} configurations with new seeds")

        def progress(spent: float, total: float) -> None:
            terminal.bar("validating", spent, total, "core s")

        found = validate(self.study, self.journal, plan, pool, terminal.log, progress, is_over)
        if found is None and is_over():
            terminal.log("too little time to validate; run the same command again to resume")
        searched = StudySummary(self.journal)
        for line in () if found is None else found.finalists:
            terminal.log(
                f"{configuration_name(line.id)} {Tally.describe(line.info)} with new seeds; "
                f"objective {line.objective:.0f} (in the search "
                f"{searched.result_of(line.id).objective:.0f})"
            )

    def _retest(
        self,
        contenders: Sequence[Contender],
        pool: EvaluationPool,
        rounds: Sequence[Round],
        is_over: Callable[[], bool],
    ) -> Contender:
        task, seed, terminal = self.study.task, (self.study.seed,), self.session.terminal
        if len(contenders) > 1:
            terminal.log(f"retesting the {len(contenders)} best SEs with fresh agents")
        terminal.bar("retesting", 0, agents_needed(len(contenders), rounds), "tests")
        return choose_best(task, contenders, seed, pool, terminal.step, rounds, is_over)


def all_runs(
    study: Study, journal: Journal, pool: Pool, log: Callable[[str], None]
) -> Iterator[ConfigurationRuns]:
    """Yield the runs of every configuration in the search and in the validation.

    Lost and damaged checkpoints are recomputed. Configurations for which that fails are skipped.
    Raises StorageFailure, and OtherVersion.
    """
    reached = journal.reached
    for line in journal.configs:
        try:
            runs = ConfigurationRuns.open(study, line.id, line.configuration, log)
            runs.spend(reached.get(line.id, 0), pool)
            validated = ConfigurationRuns.read(study, line.id, line.configuration, True)
        except (StorageFailure, OtherVersion):
            raise
        except InvalidInput as error:
            log(f"skipping {configuration_name(line.id)}: {error}")
        else:
            yield from (runs, validated)


def contenders_of(configurations: Sequence[ConfigurationRuns]) -> list[Contender]:
    """Return the confirmed SEs, and then the SEs with the highest scores in their own runs."""
    ranked = []
    for runs in configurations:
        nes = runs.run(0).nes
        for state in runs.states:
            ses = [nes.best(state)] if state.confirmed else nes.candidates(state)
            for finalist, se in zip(state.finalists, ses, strict=False):
                ranked.append(((state.confirmed, finalist.rank), Contender(se, nes.hp)))
    ranked.sort(key=lambda pair: pair[0], reverse=True)
    return [contender for _, contender in ranked[:RACERS]]
