"""The check of an action that comes from outside: an agent's, a user's, a table's."""

import operator
from typing import Any

from bilevel.errors import InvalidInput


def checked_action(action: Any, n_actions: int, first: int = 0) -> int:
    """The number, from 0, of an action, which is an integer of any kind; the actions of the task
    begin with `first`.

    Raises InvalidInput unless it is one of the task's actions.
    """
    try:
        number = operator.index(action) - first
    except TypeError:
        number = -1
    if not 0 <= number < n_actions:
        raise InvalidInput(
            f"action {action!r} is not allowed: allowed are the integers {first} to "
            f"{first + n_actions - 1}"
        )
    return number
