"""What a search, a rulebook and a comparison have found, beside the made-up cases of a console."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from schemas.files.rulebook_result import RulebookResult
from schemas.files.search_result import SearchCluster, SearchFile, SearchIndices, SensitivityIndex

GOLDEN = Path(__file__).parents[1] / "golden" / "console"
"""Of real runs: a Bayesian search, five rows of FMVSS 127, and one campaign with more latency."""
REPORT = """<!doctype html><title>report</title><h1>What came of it</h1><p id="reach"></p><script>
let reach = "kept apart";
try { reach = parent.document.title; } catch {}
document.getElementById("reach").textContent = reach;
</script>"""
"""A report with a script that tries to reach the page around it."""


def write_findings(folder: Path, run: str, other: str, cases: list[str]) -> None:
    """Give the console of ``run`` in ``folder`` all of them; their cases are some of ``cases``."""
    data = folder / "data"
    write(data, f"runs/{run}/search.json", msgspec.to_builtins(_search(cases)))
    rulebook = msgspec.json.decode((GOLDEN / "rulebook.json").read_bytes(), type=RulebookResult)
    write(data, f"runs/{run}/rulebook.json", msgspec.to_builtins(rulebook))
    comparison = json.loads((GOLDEN / "comparison.json").read_text())
    write(data, f"compare/{run}/{other}.json", comparison)
    report = folder / "report" / run / "report.html"
    report.parent.mkdir(parents=True)
    report.write_text(REPORT)
    info = read(data, f"runs/{run}/run.json")
    links = {name: f"data/runs/{run}/{name}.json" for name in ("search", "rulebook")}
    info["links"] = {**links, "report": f"report/{run}/report.html"}
    write(data, f"runs/{run}/run.json", info)


def read(data: Path, path: str) -> Any:
    """Data of a console on the disk: a script that hands over a text."""
    _, _, text = (data / f"{path}.js").read_text().removesuffix(");\n").partition(", ")
    return json.loads(json.loads(text))


def write(data: Path, path: str, value: Any) -> None:
    """Data of a console, as a script."""
    place = data / f"{path}.js"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(f"consoleData({json.dumps(path)}, {json.dumps(json.dumps(value))});\n")


def _search(cases: list[str]) -> SearchFile:
    """The real search, with failures that lie together and what parameters matter."""
    found = msgspec.json.decode((GOLDEN / "search.json").read_bytes(), type=SearchFile)
    values = found.generations[0].values[0]
    cluster = SearchCluster(mildest=cases[0], kpi=0.0, values=values, cases=cases[:2])
    first = found.parameters[0]
    index = SensitivityIndex(parameter=first, first=0.6, first_low=0.5, first_high=0.7, total=0.8)
    indices = SearchIndices(method="Sobol indices", cases=16, kpi=[index], failure=[])
    return msgspec.structs.replace(found, clusters=[cluster], indices=indices)
