"""Every code block of the documentation runs and prints what the page says; the rules stand in CONTRIBUTING.md.

A page is one test, so that pages spread over the cores.
"""

from __future__ import annotations

from pathlib import Path

import mcp  # noqa: F401  keeps the error stream of its import, so that it is no page's
import pytest
from _pytest.mark import ParameterSet

from tests.support import ROOT
from tests.support.code_blocks import BlockError, Reader, blocks_of
from tests.support.copies import extras


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
        ("x = 2", "x = y", "page.md:5: expected: the block runs\ngot: NameError"),
        ("print(told())", "print(told()); print(1)", "expected: told"),
        ("# exit code 2", "#", "expected: exit code 0\ngot: exit code 2"),
        ("% not run: needs the network", "words", "`curl` is not run by the tests"),
        ("cat out/x.txt", "cat out/x.txt | sudo tee /y", "`sudo` is not run by the tests"),
        ("```sh\nmkdir", "```bash\nmkdir", "write ```sh instead of ```bash"),
        ("mine/told.py", "../told.py", "not in the reader's folder"),
        ("...\ninspector ...", "c", "expected: a c"),
    ],
)
def test_a_page_that_is_wrong_fails_and_says_where(tmp_path: Path, old: str, new: str, says: str):
    assert GOOD.count(old) >= 1
    page = page_of(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(BlockError) as caught:
        run_page(page, tmp_path / "work")
    assert says in str(caught.value)
