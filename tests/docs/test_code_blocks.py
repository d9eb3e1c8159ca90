"""Every code block of the documentation runs and prints what the page says; the rules stand in CONTRIBUTING.md.

A page is one test, so that pages spread over the cores.
"""

from __future__ import annotations

from pathlib import Path

import mcp  # noqa: F401  keeps the error stream of its import, so that it is no page's
import pytest
from _pytest.mark import ParameterSet

from tests.support.code_blocks import Block, BlockError, Reader, blocks_of, difference
from tests.support.copies import extras

ROOT = Path(__file__).parents[2]


def is_written_by_hand(page: Path) -> bool:
    """Not one that the build makes; see .gitignore."""
    folders = page.relative_to(ROOT / "docs").parts[:-1]
    return "generated" not in folders and (page.name == "index.md" or not {"notebooks", "effects"} & set(folders))


def is_here(page: Path) -> bool:
    """Not that of an extra that was taken away."""
    return page.parent != ROOT / "docs" / "extras" or page.stem in extras()


PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if is_written_by_hand(page) and is_here(page)),
]


LONG_PAGES = tuple(
    f"docs/{name}.md"
    for name in (
        "tutorials/sample_arm",
        "tutorials/sockets",
        "tutorials/plan_poses",
        "tutorials/read_a_verdict",
        "tutorials/write_an_effect",
        "api/index",
    )
)


def state_of_samples() -> dict[str, tuple[int, int]]:
    files = (path for path in (ROOT / "sample_data").rglob("*") if path.is_file())
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in files}


def run_page(page: Path, folder: Path, *, long: bool = False) -> None:
    Reader(folder, long=long).run(blocks_of(page))


def has_code(page: Path) -> bool:
    return any(block.language in ("python", "sh") and not block.takes_long for block in blocks_of(page))


def each_with_code() -> list[ParameterSet]:
    """Pages with code, the longest for the thorough run."""
    return [
        pytest.param(page, id=name, marks=pytest.mark.thorough if name in LONG_PAGES else ())
        for page in PAGES
        if has_code(page) and (name := str(page.relative_to(ROOT)))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("page", each_with_code())
def test_the_blocks_of_a_page_run_and_print_what_it_says(page: Path, tmp_path: Path):
    before = state_of_samples()
    run_page(page, tmp_path)
    assert state_of_samples() == before, "sample_data is read only: copy it, or write elsewhere"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=str(page.relative_to(ROOT)))
        for page in PAGES
        if any(block.takes_long for block in blocks_of(page))
    ],
)
def test_the_blocks_that_take_long_do_too(page: Path, tmp_path: Path):
    run_page(page, tmp_path, long=True)


@pytest.mark.parametrize("page", [pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES[1:]])
def test_every_block_says_its_language(page: Path):
    assert [block.place for block in blocks_of(page) if not block.language] == []


# ---- the runner itself ----------------------------------------------------------------------------------------------


def page_of(folder: Path, text: str) -> Path:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    (folder / "work").mkdir()
    return page


GOOD = """
# A page

```python
x = 2
```

```python
print(f"the error is {x / 3:.4f} mm at p55")
```

```text
the   error is 0.67 mm ... p55
```

```{code-block} python
:caption: mine/told.py

def told():
    return "told"
```

````{note}
```python
from mine.told import told
print(told())
```
```text
told
```
````

```sh
mkdir -p out && printf 'a\\nb\\nc\\n' > out/x.txt
cat out/x.txt
inspector --version   # a comment
inspector check missing \\
    --json            # exit code 2: no such folder
```

```text
a
...
inspector ...
inspector: missing...
```

% not run: needs the network
```sh
curl example.org
```
"""


def test_a_page_as_it_should_be_passes(tmp_path: Path):
    run_page(page_of(tmp_path, GOOD), tmp_path / "work")
    assert (tmp_path / "work" / "out" / "x.txt").exists()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("is 0.67 mm", "is 0.60 mm", "page.md:13: the output is another"),
        ("at p55", "at p56", "p55"),
        ("the   error", "an error", "expected 'an' in\n    an error"),
        ("x = 2", "x = y", "page.md:5: expected: the block runs\ngot: NameError"),
        ("print(told())", "print(told()); print(1)", "expected: nothing after"),
        ("a comment", "exit code 1", "expected: exit code 1\ngot: exit code 0"),
        ("# exit code 2", "#", "expected: exit code 0\ngot: exit code 2"),
        ("% not run: needs the network", "words", "`curl` is not run by the tests"),
        ("cat out/x.txt", "./run serve sample_data", "`inspector serve` is not run by the tests"),
        ("cat out/x.txt", "cat out/x.txt | sudo tee /y", "`sudo` is not run by the tests"),
        ("```sh\nmkdir", "```bash\nmkdir", "write ```sh instead of ```bash"),
        ("mine/told.py", "../told.py", "not in the reader's folder"),
        ("...\ninspector ...", "c", "expected 'c' in\n    c"),
    ],
)
def test_a_page_that_is_wrong_fails_and_says_where(tmp_path: Path, old: str, new: str, says: str):
    assert GOOD.count(old) >= 1
    page = page_of(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(BlockError) as caught:
        run_page(page, tmp_path / "work")
    assert says in str(caught.value)


def test_what_takes_long_runs_only_where_it_is_asked_for(tmp_path: Path):
    page = page_of(tmp_path, "% takes long: a minute\n```python\nraise ValueError('ran')\n```\n")
    run_page(page, tmp_path / "work")
    (tmp_path / "work" / "sample_data").unlink()
    with pytest.raises(BlockError, match="ran"):
        run_page(page, tmp_path / "work", long=True)


@pytest.mark.parametrize(
    ("expected", "got", "same"),
    [
        ("rmse 0.100 mm", "rmse 0.1049 mm", True),
        ("rmse 0.100 mm", "rmse 0.1051 mm", False),
        ("p = 2e-53", "p = 2.05e-53", True),
        ("p = 2e-53", "p = 2e-52", False),
        ("x -0.5", "x 0.5", False),
        ("joint J3 of q1", "joint J4 of q1", False),
        ("13 poses", "14 poses", False),
        ("... from 0.42 to ...", "it falls from 0.43 to 0.11 mm", True),
        ("0 warnings", "1 warnings", False),
        ("p = ... (of ...), joint ...", "p = 3 (of 5 in all), joint 3 and 4", True),
        ("p = ... (of ...), joint ...", "p = 3 (of 5 in all), axis 3", False),
        ("a line\nof words", "a   line of\nwords\n", True),
        ("first\n...\nlast", "first\nlast", True),
        ("first\n...\nlast 2", "first\nlast 1\nlast 2", True),
        ("first\n...\nlast 2", "first\nlast 2\nlast 3", False),
        ("first\n...\nlast", "firsts\nlast", False),
        ("first\n...", "first", True),
        ("...", "", True),
        ("", "words", False),
        ("words", "", False),
    ],
)
def test_figures_may_differ_by_five_per_cent_and_words_not_at_all(expected: str, got: str, same: bool):
    assert (difference(expected, got) == "") == same


def test_places_are_those_of_the_file(tmp_path: Path):
    page = page_of(tmp_path, GOOD)
    lines = GOOD.splitlines()
    for block in blocks_of(page):
        assert isinstance(block, Block)
        assert lines[block.line - 1] == block.text.splitlines()[0]
