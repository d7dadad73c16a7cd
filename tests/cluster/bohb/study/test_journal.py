import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from cluster.bohb.study.journal import Journal
from tests.searches import new_search, run_to_end


@pytest.mark.parametrize("line", ["{}", "[1]", '[[0,0,0],"x",{},{}]', "nonsense", "[[0,0,0]]"])
def test_a_damaged_line_is_reported(line: str, tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=1))
    path = tmp_path / "configs.json"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], line, *lines[1:]]) + "\n")
    with pytest.raises(InvalidInput, match="damaged file"):
        Journal(tmp_path)


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_configuration_outside_the_space_is_reported(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    run_to_end(new_search(folder, brackets=1))
    path = folder / "configs.json"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    values = data.draw(st.sampled_from(lines))[1]
    name = data.draw(st.sampled_from([*values, "nes.unknown"]))
    invalid = st.none() | st.text() | st.lists(st.integers()) | st.sampled_from([-1.0, 1e9])
    values[name] = data.draw(invalid | st.just(float("nan")))
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InvalidInput, match=r"^damaged journal in "):
        new_search(folder, brackets=1)


@pytest.mark.parametrize("line", [0, 4, 8])
def test_a_result_without_its_proposal_is_reported(line: int, tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=2))
    lines = (tmp_path / "configs.json").read_text().splitlines(keepends=True)
    (tmp_path / "configs.json").write_text("".join([*lines[:line], *lines[line + 1 :]]))
    with pytest.raises(InvalidInput, match=r"damaged file .*results.json.* was never proposed"):
        Journal(tmp_path)
