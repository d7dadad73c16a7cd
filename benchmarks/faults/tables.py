"""The table of docs/reliability.md."""

from benchmarks.machine import read_result
from benchmarks.markdown import source

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
    return "\n".join([*rows, "", source(result)])


TABLES = {"faults": faults}
