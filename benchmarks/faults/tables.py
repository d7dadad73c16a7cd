"""The table of docs/reliability.md."""

import json

from benchmarks.machine import RESULTS

_YES = {True: "yes", False: "no"}


def faults() -> str:
    """What was injected into studies, and what came of it."""
    result = json.loads((RESULTS / "faults.json").read_text())
    rows = [
        "| fault | injected | results | lost | twice | identical | MLflow as on disk |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in result["rows"].values():
        identical, shown = (_YES[row["identical"]], _YES[not row["mlflow"]])
        rows.append(
            f"| {row['fault']} | {row['injected']} | {row['results']} | {row['lost']} | "
            f"{row['duplicated']} | {identical} | {shown} |"
        )
    rows.append("\nA row is one study on CartPole-v0, one trial at a time. *Identical*: journal,")
    rows.append("checkpoints (both less the measured times) and the file of the best SE are those")
    rows.append("of a study that was left in peace. *MLflow as on disk*: one run a configuration,")
    rows.append("every series unbroken and without a point twice, all files, nothing left running.")
    machine = result["machine"]
    rows.append(f"({machine['cores']} cores of {machine['processor']}; `{result['command']}`)")
    return "\n".join(rows)


TABLES = {"faults": faults}
