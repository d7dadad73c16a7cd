import json
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.bohb.study.journal import Journal
from tests.searches import new_search, run_to_end


@pytest.mark.parametrize("value", [None, "text", -1.0, 1e9, float("nan")])
@pytest.mark.parametrize("name", ["nes.std_dev", "nes.population_size", "nes.unknown"])
def test_a_configuration_outside_the_space_is_reported(
    name: str, value: object, tmp_path: Path
) -> None:
    run_to_end(new_search(tmp_path, brackets=1))
    path = tmp_path / "configs.json"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines[4][1][name] = value
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InvalidInput, match=r"^damaged journal in "):
        new_search(tmp_path, brackets=1)


@pytest.mark.parametrize("line", [0, 4, 8])
def test_a_result_without_its_proposal_is_reported(line: int, tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=2))
    lines = (tmp_path / "configs.json").read_text().splitlines(keepends=True)
    (tmp_path / "configs.json").write_text("".join([*lines[:line], *lines[line + 1 :]]))
    with pytest.raises(InvalidInput, match=r"damaged file .*results.json.* was never proposed"):
        Journal(tmp_path)
