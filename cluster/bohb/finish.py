"""The end of a study: validate its best configurations, and export the recipe and the best SE."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, StorageFailure
from bilevel.synthetic_env import save_se
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import validate
from cluster.bohb.study.definition import RECIPE_FILE, Study, configuration_name
from cluster.bohb.study.journal import ConfigLine, Journal
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
from cluster.session.context import Session
from cluster.session.terminal import count
from cluster.tracking.registry import model_address

#: Best SE of the incumbent of an interrupted study.
INCUMBENT_SE_FILE = "incumbent_se.safetensors"


@dataclass(frozen=True)
class StudyEnd:
    """Exports the results of a study and reports them in the terminal."""

    study: Study
    journal: Journal
    session: Session

    def finish(self, pool: EvaluationPool, final_agents: int, is_over: Callable[[], bool]) -> bool:
        """Validate the best configurations until `is_over`, choose the best SE of all runs, and
        score it with fresh agents; return whether there is one. Raises StorageFailure."""
        study, terminal = self.study, self.session.terminal
        self._validate(pool, is_over)
        exported = self.export_recipe()
        configurations = all_runs(study, self.journal)
        contenders = contenders_of(configurations)
        if not contenders:
            terminal.log(
                "no configuration finished a generation: see the errors above, or use more time, "
                "a larger --profile, or a --space with fewer nes.start_candidates"
            )
            return False
        before, seed, rounds = pool.real_env_steps, (study.seed,), race(final_agents)
        if len(contenders) > 1:
            terminal.log(f"retesting the {len(contenders)} best SEs with fresh agents")
        terminal.bar("retesting", 0, agents_needed(len(contenders), rounds), "tests")
        best = choose_best(study.task, contenders, seed, pool, terminal.step, rounds, is_over)
        score = evaluate_holdout(study.task, best, final_agents, seed, pool)
        tests = pool.real_env_steps - before
        learned = sum(state.real_env_steps for runs in configurations for state in runs.states)
        step = len(self.journal.results)
        path, real_steps = export_best(best.se, score, study.folder, step, learned, tests)
        terminal.log(str(score))
        terminal.log(
            f"{real_steps} steps on the real task in all runs, the scale of observations included"
        )
        if exported is not None:
            call = self.session.tracker.home.hint(f"nes {study.task.id} --recipe {study.name}")
            terminal.log(f"its recipe: {study.folder / RECIPE_FILE}; learn an SE with it by {call}")
        model = model_address(study.task.id, "newest")
        terminal.log(f"best SE: {path}  ({model} in MLflow's model registry)")
        terminal.log(f"results: {self.session.address}")
        terminal.log("run the same command again to add brackets")
        return True

    def export_recipe(self) -> ConfigLine | None:
        """Report the incumbent and write its recipe; return the incumbent, if there is one.
        Raises StorageFailure."""
        log, journal = self.session.terminal.log, self.journal
        summary = StudySummary.of(journal)
        log(
            f"{count(len(journal.results), 'result')} of "
            f"{count(len(journal.configs), 'configuration')} "
            f"({summary.model_based} proposed by the model)"
        )
        incumbent = summary.incumbent
        if incumbent is None:
            return None
        proposal = journal.proposals[incumbent.id]
        log(
            f"incumbent {configuration_name(incumbent.id)} ({proposal.origin}): "
            f"{Tally.describe(incumbent.info)}, objective {incumbent.objective:.0f}"
        )
        text = self.study.recipe_text(incumbent.id, proposal.configuration)
        write_aside(self.study.folder / RECIPE_FILE, text.encode())
        for name, value in proposal.configuration.items():
            log(f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}")
        return proposal

    def export_interrupted(self) -> None:
        """Export the recipe and the best SE of the incumbent so far. Raises StorageFailure."""
        incumbent = self.export_recipe()
        if incumbent is None:
            return
        best = ConfigurationRuns(self.study, incumbent.id, incumbent.configuration).read().best
        if best is not None:
            save_se(best, self.study.folder / INCUMBENT_SE_FILE)

    def _validate(self, pool: EvaluationPool, is_over: Callable[[], bool]) -> None:
        terminal, journal = self.session.terminal, self.journal
        progress = partial(terminal.bar, "validating", unit="core s")
        found = validate(self.study, journal, pool, terminal.log, progress, is_over)
        if found is None:
            terminal.log(
                "search or time was too short for a validation of all results with new seeds: "
                "expect the recipe to take longer than its objective (docs/tuning.md)"
            )
            return
        searched = {line.id: line.objective for line in journal.successes}
        for line in found.finalists:
            terminal.log(
                f"{configuration_name(line.id)} {Tally.describe(line.info)} with new seeds; "
                f"objective {line.objective:.0f} (in the search {searched[line.id]:.0f})"
            )


def all_runs(study: Study, journal: Journal) -> list[ConfigurationRuns]:
    """Return the runs of every configuration in the search and in the validation. Raises
    StorageFailure."""
    found = []
    for line in journal.configs:
        for validation in (False, True):
            try:
                runs = ConfigurationRuns(study, line.id, line.configuration, validation).read()
            except StorageFailure:
                raise
            except InvalidInput:  # the configuration never ran
                continue
            found.append(runs)
    return found


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
