"""Every Python snippet in the README and the docs runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SNIPPETS = [
    pytest.param(code, id=f"{page.relative_to(ROOT).with_suffix('')}-{number}")
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.S))
]


@pytest.mark.gl
@pytest.mark.parametrize("code", SNIPPETS)
def test_snippet_runs(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "snippet", "exec"), {"__name__": "__main__"})


def test_every_room_has_a_page_with_equation_picture_and_snippet_that_the_readme_links() -> None:
    readme = PAGES[0].read_text()
    rooms = [p.name for p in sorted((ROOT / "torchradiometry").iterdir()) if p.is_dir()]
    for room in set(rooms) - {"__pycache__", "cli", "demo", "models"}:
        page = ROOT / "docs" / f"{room}.md"
        for part, name in (("```python", "snippet"), ("$$", "equation"), ("![", "picture")):
            assert part in page.read_text(), f"docs/{room}.md has no {name}"
        assert f"docs/{room}.md" in readme


@pytest.mark.parametrize(
    "page",
    [*PAGES, ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_links_between_files_lead_somewhere(page: Path) -> None:
    words = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.S)
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", words)
    missing = [link for link in links if not (page.parent / link).exists()]
    assert not missing


def test_readme_names_the_test_command_for_ci() -> None:
    readme = PAGES[0].read_text()
    command = re.search(r"<!-- test-command -->\n```bash\n(.*?)```", readme, re.S)
    assert command is not None
    assert "-m pytest" in command[1]
