"""The table of docs/reliability.md."""

from benchmarks.machine import read_result

_YES = {True: "yes", False: "no"}


def faults() -> str:
    """Faults and their effects, one row per fault."""
    result = read_result("faults")
    rows = [
        "| fault | injected | results | lost | twice | identical | MLflow as on disk |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in result["rows"].values():
        identical, shown = (_YES[row["identical"]], _YES[not row["mlflow"]])
        code = f" (exit code {row['exit_code']})" if row["exit_code"] else ""
        rows.append(
            f"| {row['fault']}{code} | {row['injected']} | {row['results']} | {row['lost']} | "
            f"{row['duplicated']} | {identical} | {shown} |"
        )
    rows.append("\nA row is one study on CartPole-v0, one trial at a time unless it says two; it")
    rows.append(
        "ended with the exit code 0 unless another is given. *Identical*: journal (with two"
    )
    rows.append(
        "trials at a time in any order), checkpoints (both less the measured times) and the"
    )
    rows.append("file of the best SE are those of a study that was left in peace. *MLflow as on")
    rows.append(
        "disk*: one run a configuration, no other runs, every series unbroken and without a"
    )
    rows.append("point twice, every file there (by name), nothing left running; a study that ends")
    rows.append(
        "while MLflow is away names the command that writes the rest, which was then given."
    )
    machine = result["machine"]
    rows.append(f"({machine['cores']} cores of {machine['processor']}; `{result['command']}`)")
    return "\n".join(rows)


TABLES = {"faults": faults}
