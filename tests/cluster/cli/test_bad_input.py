"""Invalid input of all commands: one line on stderr, exit code 2, and no file written."""

import shlex
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
from click.testing import CliRunner

from bilevel.synthetic_env import save_se
from bilevel.tasks import get_task
from cluster.cli.program import cli
from tests.ses import make_se

#: Arguments and a part of the message. Files without a folder are in the folder `inputs`.
ROWS = [
    # arguments of any command
    ("bohb", "Missing argument 'TASK'"),
    ("nes CartPole-v0 --seed 0.5", "'--seed': '0.5' is not a valid integer"),
    ("nes CartPole-v0 --population 0", "'--population': 0 is not in the range x>=1"),
    ("bohb CartPole-v0 --brackets 99999999", "not in the range 1<=x<=1000"),
    ("bohb CartPole-v0 --time-budget soon", "'soon' is not a duration"),
    # tasks
    ("nes CartPole-v9", "unknown task 'CartPole-v9': allowed are CartPole-v0, CartPole-v1"),
    ("nes CartPole", "'CartPole' has no version, such as CartPole-v1"),
    ("nes FrozenLake-v1,slippery", "'slippery' is no keyword argument"),
    ("nes FrozenLake-v1 --env-kwargs slippery", "not a keyword argument such as is_slippery:False"),
    ("nes FrozenLake-v1 --env-kwargs slip:1", "unexpected keyword argument 'slip'"),
    ("nes FrozenLake-v1 --wrapper Flat", "must be MODULE:CLASS; got 'Flat'"),
    ("nes FrozenLake-v1 --wrapper os:system", "not a subclass of gymnasium.Wrapper"),
    ("nes FrozenLake-v1 --wrapper nowhere:Flat", "No module named 'nowhere'"),
    ("nes Pendulum-v1 --agent ddqn", "agent 'ddqn' has no continuous actions: allowed are td3"),
    ("evaluate --real Pendulum-v1 --agent ddqn", "agent 'ddqn' has no continuous actions"),
    ("experiment success Pendulum-v1", "experiments need discrete actions"),
    ("bohb CartPole-v0 --worst-score 200", "below the solved reward, 195; got 200"),
    # agents
    ("nes CartPole-v0 --agent dqn", "unknown agent 'dqn': allowed are ddqn"),
    # recipes and hyperparameters
    (
        "nes CartPole-v0 --recipe x",
        "unknown recipe 'x': allowed are default, exogenous, paper, authors",
    ),
    ("recipe x", "unknown recipe 'x'"),
    ("nes CartPole-v0 --recipe none.toml", "cannot read the recipe "),
    ("nes CartPole-v0 --recipe nonsense.toml", "cannot read the recipe"),
    ("nes CartPole-v0 --recipe empty.toml", "empty.toml"),
    ("nes CartPole-v0 --vary-hp x", "'--vary-hp': 'x' is not one of 'no', 'small'"),
    ("nes CartPole-v0 --set nes.std_dev", "'nes.std_dev' is not a setting"),
    ("nes CartPole-v0 --set nes.update=x", "nes.update: must be 'nes', "),
    ("nes CartPole-v0 --set nes.std_dev=-1", "nes.std_dev: must be greater than or equal to"),
    ("nes CartPole-v0 --set nes.mirrored_sampling=false", "needs nes.mirrored_sampling true"),
    ("evaluate se.safetensors --set nes.std_dev=0.1", "unknown hyperparameter 'nes.std_dev'"),
    # studies
    ("bohb CartPole-v0 --profile huge", "'huge' is not one of 'smoke', 'local'"),
    ("bohb CartPole-v0 --method luck", "'luck' is not one of 'bohb', 'hyperband'"),
    ("bohb CartPole-v0 --space x", "unknown search space 'x': allowed are full, core"),
    ("bohb CartPole-v0 --space none.json", "cannot read the search space"),
    ("bohb CartPole-v0 --space full", "--recipe authors"),
    ("bohb CartPole-v0 --set nes.solved_for=9", "nes.solved_for cannot be set in a search"),
    ("bohb CartPole-v0 --prior none --set nes.averaging=0.5", "nes.averaging is searched"),
    (
        "bohb CartPole-v0 --space full --recipe authors --vary-hp all",
        "searches ddqn.",
    ),
    # experiments
    ("experiment x CartPole-v0", "'x' is not one of 'success', 'transfer'"),
    ("experiment cost CartPole-v0 --size x", "'x' is not one of 'smoke'"),
    ("experiment report CartPole-v0 --size smoke", "experiment all CartPole-v0 --size smoke"),
    # SEs
    ("evaluate", "nothing to train on"),
    ("evaluate weights.safetensors", "weights.safetensors"),
    ("evaluate se.safetensors --step-limit 9", "need --real"),
    ("evaluate se.safetensors --real Acrobot-v1", "all sources must have the same task"),
    ("show models:/SE-CartPole-v0@newest", "MLflow has no SE at 'models:/SE-CartPole-v0@newest'"),
    ("show se.safetensors --out a.txt", "cannot write 'a.txt': allowed are *.png, *.svg"),
    ("export se.safetensors se.txt", "cannot write 'se.txt': allowed are *.onnx, *.pt2"),
    ("export none.safetensors se.onnx", "no SE file at "),
    ("export se.safetensors none/a.onnx", "cannot write 'none/a.onnx': No such file"),
    ("export se.safetensors se.safetensors/a.pt2", "a.pt2'"),
    # homes and names
    ("nes CartPole-v0 --home a?b", "must not contain '?' or '%'"),
    ("nes CartPole-v0 --home /proc/none", "cannot write to '/proc/none'"),
    ("zoo build CartPole-v0 --folder /proc/none", "cannot write to '/proc/none'"),
    ("nes CartPole-v0 --name ../escape", "name '../escape' is not allowed"),
    ("sync none", "no run is called 'none'"),
    ("ui", "no runs in"),
    # clusters and MLflow
    ("nes CartPole-v0 --workers 4096", "4096 workers need 4096 cores: the cluster has"),
    ("nes CartPole-v0 --address 127.0.0.1:1", "no Ray cluster at '127.0.0.1:1'"),
    (
        "bohb CartPole-v0 --address ray://127.0.0.1:1",
        "is not valid: allowed are host:port and auto",
    ),
    ("nes CartPole-v0 --tracking-uri http://127.0.0.1:1", "no MLflow server at"),
    ("nes CartPole-v0 --tracking-uri ftp://x", "tracking URI 'ftp://x' is not valid"),
    ("nes CartPole-v0 --tracking-uri http://me:secret@127.0.0.1:1", "'http://***@127.0.0.1:1'"),
]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the files that ROWS name."""
    folder = tmp_path_factory.mktemp("inputs")
    save_se(make_se(get_task("CartPole-v0")), folder / "se.safetensors")
    safetensors.numpy.save_file({"weight": np.zeros(3)}, folder / "weights.safetensors")
    (folder / "nonsense.toml").write_text("nonsense")
    (folder / "empty.toml").write_text('agents = ["ddqn"]\n')
    return folder


@pytest.mark.parametrize(("arguments", "message"), ROWS, ids=[row[0] for row in ROWS])
def test_bad_input(
    arguments: str, message: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("MLFLOW_TRACKING_URI", "RAY_ADDRESS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    words = [
        str(inputs / word) if (inputs / word.partition("/")[0]).is_file() else word
        for word in shlex.split(arguments)
    ]
    before = sorted(inputs.iterdir())
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("bilevel: ")
    assert result.stderr.count("\n") == 1
    assert message in result.stderr
    assert "secret" not in result.stderr
    assert result.stdout == ""
    assert [*tmp_path.iterdir()] == []
    assert sorted(inputs.iterdir()) == before
