"""Types of parameters that click does not have."""

import json
import re
from typing import Any

import click

_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


class Duration(click.ParamType[float]):
    """Parse `90s`, `45m`, `2h` or plain seconds into seconds."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", str(value))
        if match is None or float(match[1]) == 0:
            self.fail(
                f"{value!r} is not a duration: allowed are 90s, 45m, 2h, or a number of seconds"
            )
        return float(match[1]) * _SECONDS[match[2]]


#: A number of at least 1.
POSITIVE = click.IntRange(min=1)


class Setting(click.ParamType[tuple[str, Any]]):
    """Parse `section.field=value` into the name and a number, bool or string."""

    name = "section.field=value"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, Any]:
        name, _, text = str(value).partition("=")
        if not (name and text):
            self.fail(f"{value!r} is not a setting: it has the form nes.std_dev=0.03")
        try:
            return name, json.loads(text)
        except ValueError:
            return name, text
