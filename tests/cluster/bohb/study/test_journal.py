import json
from pathlib import Path

import pytest
from hpbandster.core.result import logged_results_to_HBS_result
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from cluster.bohb.study.journal import Journal
from tests.searches import loss_of, new_search, run_to_end


def test_hpbandster_reads_it(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path), fail=(2,))
    result = logged_results_to_HBS_result(str(tmp_path))
    assert len(result.get_all_runs()) == len(jobs)
    best = min((j for j in jobs if j.budget == 9), key=loss_of)
    assert result.get_incumbent_id() == best.id


@given(cut=st.integers(1, 60))
@settings(max_examples=30)
def test_a_torn_last_line_is_dropped(cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("journal")
    run_to_end(new_search(folder, brackets=1))
    path = folder / "results.json"
    content = path.read_bytes()
    last = content[:-1].rfind(b"\n") + 1
    path.write_bytes(content[: max(len(content) - cut, last)])
    torn = path.read_bytes()
    assert len(Journal(folder).results) == 12
    assert path.read_bytes() == torn  # reading does not change the file
    run_to_end(new_search(folder, brackets=1))
    assert len(Journal(folder).results) == 13


@pytest.mark.parametrize("line", ["{}", "[1]", '[[0,0,0],"x",{},{}]', "nonsense", "[[0,0,0]]"])
def test_damage_in_the_middle_is_told(line: str, tmp_path: Path) -> None:
    run_to_end(new_search(tmp_path, brackets=1))
    path = tmp_path / "configs.json"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], line, *lines[1:]]) + "\n")
    with pytest.raises(InvalidInput, match="damaged file"):
        Journal(tmp_path)


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_configuration_outside_the_space_is_told(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    run_to_end(new_search(folder, brackets=1))
    path = folder / "configs.json"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    values = data.draw(st.sampled_from(lines))[1]
    name = data.draw(st.sampled_from([*values, "nes.unknown"]))
    wrong = st.none() | st.text() | st.lists(st.integers()) | st.just(-1.0) | st.just(1e9)
    values[name] = data.draw(wrong | st.just(float("nan")))
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InvalidInput, match=r"^damaged '.*configs.json', line \d+: "):
        new_search(folder, brackets=1)
