"""The cards of the committed studies: how each was made, and what it found."""

from collections.abc import Iterable

from benchmarks.markdown import table
from benchmarks.search.studies import STUDIES, committed, summary, time_spent
from bilevel.decode import decode
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import Study, configuration_name
from cluster.storage.author import Author
from cluster.storage.run_folder import read_settings

#: The document that has them.
FILE = STUDIES / "README.md"


def cards() -> str:
    """A card for each study. Raises NotMeasured without any."""
    return "\n\n".join(map(_card, committed()))


def _card(study: Study) -> str:
    told = summary(study)
    author = decode(Author, read_settings(study.folder)["author"], study.name)
    incumbent = told.incumbent
    assert incumbent is not None
    searched, validated = time_spent(told)
    configurations = f"{len(told.journal.configs)} configurations, {told.model_based} of the model"
    facts = [
        ("command", f"`{author.command}`"),
        ("version", f"commit {author.commit[:7]}"),
        ("method, seed", f"{study.method_name}, {study.seed}"),
        ("budgets, core seconds", ", ".join(map(str, study.schedule.budgets))),
        ("search", f"{configurations}; {searched}"),
        ("validation", f"{len(told.finalists)} finalists; {validated}"),
        (
            "incumbent",
            f"{configuration_name(incumbent.id)}: {incumbent.objective:.0f} core seconds per SE "
            "over new seeds",
        ),
        ("hyperparameters", "recipe → incumbent (range)"),
        *_hyperparameters(study, told),
    ]
    return f"## {study.task.id}/{study.name}\n\n{table(['', ''], facts)}"


def _hyperparameters(study: Study, told: StudySummary) -> Iterable[tuple[str, str]]:
    assert told.incumbent is not None
    found, space = told.configuration(told.incumbent.id), study.stored_space()
    for name, before in study.of_recipe.items():
        dimension = space[name]
        choices = getattr(dimension, "choices", None)
        range_of = (
            f"{_told(dimension.to_value(0.0))} to {_told(dimension.to_value(1.0))}"
            if choices is None
            else ", ".join(map(_told, choices))
        )
        yield f"`{name}`", f"{_told(before)} → {_told(found[name])} ({range_of})"


def _told(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
