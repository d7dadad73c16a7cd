"""The prior of a search: its recipe, or the results of another study.

With the recipe, the first configuration has the recipe's values, and about half of the random ones
are drawn around it. With another study, BOHB's model starts with that study's results. They are
copied once, so that later changes of that study have no effect.
"""

from bilevel.durable import checksum, write_aside
from bilevel.errors import InvalidInput, unknown_value
from bilevel.seeds import Purpose, derive
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Configuration, Journal
from cluster.storage.run_folder import SETTINGS_FILE

#: Priors besides the names of studies.
PRIORS = ("none", "recipe")

#: Folder with the copied journal of the prior study.
_COPY = "earlier"


def search_seed(study: Study) -> int:
    """Return the seed of proposals and runs. It depends on the name of a prior study, because two
    studies with equal seeds would draw the same configurations."""
    if study.prior in PRIORS:
        return study.seed
    key = int(checksum(study.prior.encode())[:8], 16)
    return derive(study.seed, Purpose.CONTINUATION, key)


def prior_configuration(study: Study) -> Configuration | None:
    """Return the configuration nearest to the recipe; None unless the recipe is the prior. Raises
    InvalidInput if the space forbids it."""
    if study.prior != "recipe":
        return None
    from search_spaces.prior import nearest  # imports ConfigSpace, which trials do not need

    return nearest(study.space.build(study.agents), study.of_recipe)


def earlier_results(study: Study) -> Journal | None:
    """Return the copied journal of the prior study; None unless a study is the prior."""
    return None if study.prior in PRIORS else Journal(study.folder / _COPY)


def check_prior(study: Study) -> None:
    """Raise InvalidInput if the space forbids the recipe, or if BOHB's model cannot use the results
    of the prior study."""
    prior_configuration(study)
    if not _is_missing(study):
        return
    folder, budgets = study.folder.parent / study.prior, study.schedule.budgets
    if not (folder / SETTINGS_FILE).exists():
        raise unknown_value("prior", study.prior, (*PRIORS, "and studies on the same task"))
    if study.method != "bohb":
        reason = "only the method bohb has a model"
    elif Study.read(folder).stored_space() != study.space.build(study.agents):
        reason = "it searched another space"
    elif not any(line.budget in budgets for line in Journal(folder).results):
        reason = f"it has no results at the budgets {', '.join(map(str, budgets))}"
    else:
        return
    raise InvalidInput(f"the study {study.prior!r} cannot be the prior: {reason}")


def copy_prior(study: Study) -> None:
    """Copy the journal of the prior study, once. Raises InvalidInput, and StorageFailure."""
    if not _is_missing(study):
        return
    copy = study.folder / f".{_COPY}"
    # A running study writes configurations before results, so results are copied first.
    for path in reversed(Journal(study.folder.parent / study.prior).paths):
        write_aside(copy / path.name, path.read_bytes())
    copy.replace(study.folder / _COPY)


def _is_missing(study: Study) -> bool:
    """Return whether the prior is a study whose journal has not been copied."""
    return study.prior not in PRIORS and not (study.folder / _COPY).exists()
