"""The table of `docs/hard-cases.md`: case kind x member x dtype -> outcome.

    python -m tests.hard_cases.table

runs the whole bank and writes the table between the two markers of the page. Members of a family
with the same outcomes share a row.
"""

from __future__ import annotations

from pathlib import Path

from tests.hard_cases.bank import DTYPES, WORDS
from tests.hard_cases.policy import NAMED
from tests.hard_cases.survey import FAMILIES, MEMBERS, Survey, kind_names, survey

PAGE = Path(__file__).resolve().parents[2] / "docs" / "hard-cases.md"
START, END = "<!-- table: written by tests.hard_cases.table -->", "<!-- end of table -->"
HEADINGS = {
    "source": "Sources",
    "material": "Materials",
    "layer": "Layers",
    "solver": "Solvers",
    "adjoint": "Adjoints",
    "transport": "Form factors",
    "function": "Functions",
}
ALL = "all"


def table(found: dict[str, Survey]) -> str:
    """The text between the markers, of the surveys by member."""
    lines = ["| word | meaning |", "|---|---|"]
    lines += [f"| {word} | {meaning} |" for word, meaning in WORDS.items()]
    lines += [f"| {n.word} | {n.reason} (`{n.member}`, {n.kind}) |" for n in NAMED]
    for family in FAMILIES:
        lines += ["", f"### {HEADINGS[family]}", "", _row("case", "members", *map(_short, DTYPES))]
        lines.append("|---" * (2 + len(DTYPES)) + "|")
        members = {m.split("-")[1]: found[m] for m in MEMBERS if m.startswith(family + "-")}
        lines += [row for kind in kind_names() for row in _rows(kind, members)]
    return "\n".join(lines)


def _short(dtype: object) -> str:
    return str(dtype).removeprefix("torch.")


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _rows(kind: str, members: dict[str, Survey]) -> list[str]:
    """One row for each group of members with the same outcomes."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, survey_of in members.items():
        if kind in survey_of.words:
            groups.setdefault(survey_of.words[kind], []).append(name)
    every = len(members)
    return [
        _row(kind, ALL if len(names) == every else ", ".join(names), *words)
        for words, names in groups.items()
    ]


def read_table(text: str) -> dict[str, dict[str, tuple[str, ...]]]:
    """Words by member and kind, of a page with a table."""
    found: dict[str, dict[str, tuple[str, ...]]] = {member: {} for member in MEMBERS}
    family = ""
    families = {heading: name for name, heading in HEADINGS.items()}
    for line in text.split(START)[1].split(END)[0].splitlines():
        if line.startswith("### "):
            family = families[line[4:]]
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if not family or len(cells) != 2 + len(DTYPES) or cells[0] == "case":
            continue
        own = [c.name for c in FAMILIES[family]]
        for name in own if cells[1] == ALL else cells[1].split(", "):
            found[f"{family}-{name}"][cells[0]] = tuple(cells[2:])
    return found


def main() -> None:
    found = {}
    for member in MEMBERS:
        found[member] = survey(member)
        for fault in found[member].faults:
            print(f"{member}: {fault}", flush=True)
    page = PAGE.read_text()
    before, after = page.split(START)[0], page.split(END)[1]
    PAGE.write_text(f"{before}{START}\n{table(found)}\n{END}{after}")


if __name__ == "__main__":
    main()
