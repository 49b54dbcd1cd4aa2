"""What the documents tell people to type works."""

import re
import shlex
from pathlib import Path

from orchestrator.command.app import status

SWAP = (Path(__file__).parents[1] / "docs" / "swap.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(sh|python)\n(.*?)```", SWAP, flags=re.DOTALL)


def test_swap_a_plant(tmp_path, monkeypatch, capsys):
    """Every command of docs/swap.md ends well, in the order of the page, in one folder."""
    monkeypatch.chdir(tmp_path)
    for language, text in BLOCKS:
        if language == "python":
            name = text.partition("\n")[0].removeprefix("# ")
            Path(name).write_text(text, encoding="utf-8")
            continue
        for line in text.replace("\\\n", " ").splitlines():
            words = shlex.split(line)
            may_differ = words[-2:] == ["||", "true"]
            code = status(words[1:-2] if may_differ else words[1:])
            told = capsys.readouterr()
            assert code in ((0, 1) if may_differ else (0,)), f"{line}\n{told.out}{told.err}"


def test_the_page_has_code_of_both_kinds():
    """The page is not empty for a reason that nobody notices."""
    assert {language for language, _ in BLOCKS} == {"sh", "python"}
