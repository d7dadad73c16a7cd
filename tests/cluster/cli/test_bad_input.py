"""Invalid input of all commands: one line on stderr, exit code 2, and no file written."""

import shlex
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
from click.testing import CliRunner

from bilevel.recipes import load_recipe, recipe_text
from bilevel.synthetic_env import save_se
from bilevel.tasks import get_task
from cluster.cli.program import cli
from tests.agent_files import forgotten_afterwards
from tests.documents import documented_agent
from tests.ses import make_se

#: Arguments and a part of the message. Files without a folder are in the folder `inputs`.
ROWS = [
    # arguments of any command
    ("bohb", "Missing argument 'TASK'"),
    ("nes CartPole-v0 --name ''", "--name: the value is empty"),
    ("nes CartPole-v0 --home=", "--home: the value is empty"),
    ("bohb CartPole-v0 --study ''", "--study: the value is empty"),
    ("nes CartPole-v0 --seed 0.5", "'--seed': '0.5' is not a valid integer"),
    ("nes CartPole-v0 --population 0", "'--population': 0 is not in the range x>=1"),
    ("bohb CartPole-v0 --brackets 99999999", "not in the range 1<=x<=1000"),
    ("bohb CartPole-v0 --time-budget soon", "'soon' is not a duration"),
    ("experiment cost CartPole-v0 --ses 0", "0 is not in the range 1<=x<=1000"),
    ("ui --port 99999", "'--port': 99999 is not in the range 1<=x<=65535"),
    # tasks
    ("nes CartPole-v9", "unknown task 'CartPole-v9': allowed are CartPole-v0, Acrobot-v1"),
    ("nes CartPole", "'CartPole' has no version: allowed are CartPole-v0, CartPole-v1"),
    ("nes Pendulum-v1", "Pendulum-v1 has actions Box"),
    ("nes Taxi-v4", "Taxi-v4"),
    ("experiment cost CartPole-v9", "unknown task 'CartPole-v9'"),
    ("bohb CartPole-v0 --worst-score 200", "below the solved reward, 195; got 200"),
    # agents
    ("nes CartPole-v0 --agent dqn", "unknown agent 'dqn': allowed are ddqn"),
    ("experiment cost CartPole-v0 --agent x", "unknown agent 'x'"),
    ("evaluate se.safetensors --agent-file unused_agent.py", "give --agent unused"),
    # recipes and hyperparameters
    ("nes CartPole-v0 --recipe x", "unknown recipe 'x': allowed are default, paper, authors"),
    ("bohb CartPole-v0 --recipe x", "unknown recipe 'x'"),
    ("evaluate --real CartPole-v0 --recipe x", "unknown recipe 'x'"),
    ("recipe x", "unknown recipe 'x'"),
    ("nes CartPole-v0 --recipe none.toml", "cannot read the recipe "),
    ("nes CartPole-v0 --recipe nonsense.toml", "is not a TOML file"),
    ("nes CartPole-v0 --recipe unknown.toml", "unknown entry 'bar'"),
    ("evaluate se.safetensors --recipe td3.toml", "has no section [td3]"),
    ("nes CartPole-v0 --vary-hp x", "unknown variation of agents 'x'"),
    ("evaluate --real CartPole-v0 --vary-hp x", "unknown variation of agents 'x'"),
    ("nes CartPole-v0 --set nes.std_dev", "'nes.std_dev' is not a setting"),
    ("nes CartPole-v0 --set nes.update=x", "unknown nes.update 'x'"),
    ("nes CartPole-v0 --set nes.std_dev=-1", "std_dev must be float, 1e-06 to"),
    ("bohb CartPole-v0 --set nes.std_dev=x", "float, 1e-06 to 10.0; got 'x'"),
    ("nes CartPole-v0 --set nes.price=1", "unknown hyperparameter 'nes.price'"),
    ("nes CartPole-v0 --set td3.discount=1", "td3.discount"),
    ("nes CartPole-v0 --generations 3 --set nes.generations=4", "is given twice, as 3 and as 4"),
    ("nes CartPole-v0 --set nes.mirrored_sampling=false", "needs nes.mirrored_sampling true"),
    ("nes CartPole-v0 --population 999999", "population_size must be int, 1 to"),
    ("evaluate se.safetensors --set nes.std_dev=0.1", "unknown hyperparameter 'nes.std_dev'"),
    ("evaluate se.safetensors --set td3.batch_size=8", "td3.batch_size"),
    (
        "evaluate se.safetensors --max-episodes 100 --set ddqn.max_episodes=50",
        "ddqn.max_episodes is given twice, as 100 and as 50",
    ),
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
    ("experiment x CartPole-v0", "unknown experiment 'x': allowed are success, transfer"),
    ("experiment cost CartPole-v0 --size x", "unknown size 'x': allowed are smoke"),
    ("experiment report CartPole-v0 --size smoke", "experiment all CartPole-v0 --size smoke"),
    # SEs
    ("evaluate", "nothing to train on"),
    ("evaluate weights.safetensors", "weights.safetensors"),
    ("evaluate se.safetensors --task Acrobot-v1", "is an SE for CartPole-v0"),
    ("evaluate se.safetensors --step-limit 9", "need --real"),
    ("evaluate se.safetensors --real Acrobot-v1", "all sources must have the same task"),
    ("show models:/SE-CartPole-v0@newest", "MLflow has no SE at 'models:/SE-CartPole-v0@newest'"),
    ("show se.safetensors --out a.txt", "cannot draw 'a.txt': allowed are files .png"),
    ("export se.safetensors se.txt", "cannot export to 'se.txt': allowed are *.onnx (ONNX)"),
    ("export none.safetensors se.onnx", "no SE file at "),
    ("export se.safetensors none/a.onnx", "cannot write 'none/a.onnx': No such file"),
    ("export se.safetensors se.safetensors/a.pt2", "a.pt2'"),
    ("import none.pt a.safetensors", "no file at "),
    ("import se.safetensors a.safetensors", "is no SE of the paper's code"),
    ("import se.safetensors a.pt", "cannot import to 'a.pt': allowed is *.safetensors"),
    ("import se.safetensors se.safetensors", "to itself"),
    # homes and names
    ("nes CartPole-v0 --home a?b", "must have no ? and %"),
    ("nes CartPole-v0 --home /proc/none", "cannot write to '/proc/none'"),
    ("bohb CartPole-v0 --dry-run --home /proc/none", "cannot write to '/proc/none'"),
    ("zoo build CartPole-v0 --folder /proc/none", "cannot write to '/proc/none'"),
    ("nes CartPole-v0 --name ../escape", "name '../escape' is not allowed"),
    ("bohb CartPole-v0 --study a/b", "name 'a/b' is not allowed"),
    ("sync none", "no run is called 'none'"),
    ("ui", "no runs in"),
    # clusters and MLflow
    ("nes CartPole-v0 --workers 4096", "4096 workers need 4096 cores: the cluster has"),
    ("bohb CartPole-v0 --workers-per-trial 4096", "4096 workers need 4096 cores"),
    ("nes CartPole-v0 --address 127.0.0.1:1", "no Ray cluster at '127.0.0.1:1'"),
    ("nes CartPole-v0 --address nowhere", "Ray address 'nowhere' is not valid"),
    (
        "bohb CartPole-v0 --address ray://127.0.0.1:1",
        "is not valid: allowed are host:port and auto",
    ),
    ("nes CartPole-v0 --tracking-uri http://127.0.0.1:1", "no MLflow server at"),
    ("nes CartPole-v0 --tracking-uri ftp://x", "tracking URI 'ftp://x' is not valid"),
    ("nes CartPole-v0 --tracking-uri http://[::1", "tracking URI 'http://[::1' is not valid"),
    ("nes CartPole-v0 --tracking-uri mysql://me:secret@h/db", "mysql"),
    ("nes CartPole-v0 --tracking-uri http://me:secret@127.0.0.1:1", "'http://***@127.0.0.1:1'"),
]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the files that ROWS name."""
    folder = tmp_path_factory.mktemp("inputs")
    save_se(make_se(get_task("CartPole-v0")), folder / "se.safetensors")
    safetensors.numpy.save_file({"weight": np.zeros(3)}, folder / "weights.safetensors")
    recipe = recipe_text(load_recipe("default", "CartPole-v0"), "")
    (folder / "nonsense.toml").write_text("nonsense")
    (folder / "unknown.toml").write_text(f"bar = 3\n{recipe}")
    (folder / "td3.toml").write_text(recipe.replace('agents = ["ddqn"]', 'agents = ["td3"]'))
    (folder / "unused_agent.py").write_text(documented_agent().replace('"reinforce"', '"unused"'))
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
    with forgotten_afterwards():
        result = CliRunner().invoke(cli, words)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("bilevel: ")
    assert result.stderr.count("\n") == 1
    assert message in result.stderr
    assert "secret" not in result.stderr
    assert result.stdout == ""
    assert [*tmp_path.iterdir()] == []
    assert sorted(inputs.iterdir()) == before
