"""The code blocks of a Markdown page, and a reader who types them one after the other.

A page's ```python blocks run in one namespace, its ```sh blocks line by line, all in one folder in which `sample_data`
is the project's. A ```text block directly behind a code block is what the reader should see then. A block with a
`:caption:` is a file, written under that name. What cannot run here says so in the line before it: `% not run: reason`.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import traceback
import types
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from markdown_it import MarkdownIt

from inspector.cli.commands import commands
from inspector.cli.parser import main

ROOT = Path(__file__).parents[2]
COMMANDS = set(commands()) - {"serve"} | {"--version", "--help"}
PROGRAMS = set(
    re.findall(
        r"\w+",
        "cat cmp cp cut diff echo find grep head jq ls mkdir mv printf python rm sed sort tail tar test touch tr uniq "
        "unzip wc zip",
    )
)
NOT_SH = ("bash", "shell", "console", "zsh", "shell-session")
DIRECTIVES_OF_CODE = ("code-block", "code", "sourcecode")
BEFORE = re.compile(r"^\s*(?:%|<!--)\s*(not run|takes long)\s*:?\s*(.*?)\s*(?:-->)?\s*$")
OTHER_EXIT = re.compile(r"#.*\bexit(?:s with| code)?\s+(\d)")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?!\w)")
TOLERANCE = 0.05
SECONDS = 120


class BlockError(AssertionError):
    """A block of a page that does not do what the page says."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int  # of its first line of content, counted from 1
    language: str
    text: str
    file: str = ""  # the name under which the reader writes it
    not_run: str = ""  # why it is not run
    takes_long: bool = False
    follows: bool = False  # directly behind another block, with blank lines at most between

    @property
    def place(self) -> str:
        """File and line, as an editor opens them."""
        page = self.page.relative_to(ROOT) if self.page.is_relative_to(ROOT) else self.page
        return f"{page}:{self.line}"


# ---- reading --------------------------------------------------------------------------------------------------------


def blocks_of(page: Path) -> list[Block]:
    """All fenced blocks of a page in their order, those in notes, tabs and cards too."""
    return list(_blocks(page, page.read_text(encoding="utf-8"), 0))


def _blocks(page: Path, text: str, offset: int) -> Iterator[Block]:
    lines = text.splitlines()
    end = -1  # of the block before
    for token in MarkdownIt().parse(text):
        if token.type != "fence" or token.map is None:
            continue
        first, last = token.map
        info = token.info.strip()
        directive = re.match(r"\{([\w-]+)\}\s*(.*)", info)
        content, line = token.content, offset + first + 2
        options: dict[str, str] = {}
        if directive:
            options, content, skipped = _directive_options(content)
            line += skipped
            if directive[1] not in DIRECTIVES_OF_CODE:
                if re.search(r"^\s*(```|~~~)", content, re.MULTILINE):
                    yield from _blocks(page, content, line - 1)
                continue
            info = directive[2]
        why, what = _said_before(lines, first)
        yield Block(
            page,
            line,
            info.split()[0].lower() if info else "",
            content,
            file=options.get("caption", "").strip("`"),
            not_run=what or why if why == "not run" else "",
            takes_long=why == "takes long",
            follows=end >= 0 and not any(between.strip() for between in lines[end:first]),
        )
        end = last


def _directive_options(content: str) -> tuple[dict[str, str], str, int]:
    lines = content.splitlines(keepends=True)
    options = {}
    taken = 0
    for line in lines:
        option = re.match(r":([\w-]+):\s*(.*)", line)
        if not option:
            break
        options[option[1]] = option[2].strip()
        taken += 1
    if taken < len(lines) and taken and not lines[taken].strip():
        taken += 1
    return options, "".join(lines[taken:]), taken


def _said_before(lines: list[str], first: int) -> tuple[str, str]:
    above = next((line for line in reversed(lines[:first]) if line.strip()), "")
    said = BEFORE.match(above)
    return (said[1], said[2]) if said else ("", "")


# ---- comparing ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stretch:
    """Text between two `...` of a page; its figures agree within 5 % with those printed."""

    text: str
    whole_words: tuple[bool, bool]  # whether it begins and ends where words do

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """The text, each figure a group."""
        parts = NUMBER.split(self.text)
        body = f"({NUMBER.pattern})".join(re.escape(part) for part in parts)
        before = r"(?<!\S)" if self.whole_words[0] else ""
        return re.compile(before + body + (r"(?!\S)" if self.whole_words[1] else ""))

    @cached_property
    def figures(self) -> list[float]:
        """Numbers of the stretch as the page has them."""
        return [float(number) for number in NUMBER.findall(self.text)]

    def ends(self, printed: str, start: int, *, anywhere: bool, at_end: bool) -> int:
        """End of the stretch in the printed text, searched from `start` or only there; -1 where it is missing."""
        while (found := (self.pattern.search if anywhere else self.pattern.match)(printed, start)) is not None:
            near = (
                abs(float(had) - wanted) <= TOLERANCE * abs(wanted)
                for had, wanted in zip(found.groups(), self.figures, strict=True)
            )
            if all(near) and (not at_end or found.end() == len(printed)):
                return found.end()
            if not anywhere:
                return -1
            start = found.start() + 1
        return -1


def stretches(expected: str) -> list[Stretch]:
    """A page's text cut at each `...`."""
    parts = re.split(r"(\s?\.\.\.(?:\s|$)|(?:^|\s)\.\.\.|\.\.\.)", f"{expected} ".strip())
    texts, cuts = parts[::2], ["", *parts[1::2], ""]
    return [
        Stretch(text, (before[-1:] != "." or not before, after[:1] != "." or not after))
        for text, before, after in zip(texts, cuts[:-1], cuts[1:], strict=True)
    ]


def difference(expected: str, got: str) -> str:
    """First disagreement between a page's text block and the output, "" where they agree.

    Spaces and line ends are alike, so that a page may break long lines; `...` stands for any text, of many lines too.
    """
    printed = " ".join(got.split())
    at = 0
    wanted = stretches(" ".join(expected.split()))
    for number, stretch in enumerate(wanted):
        anywhere, last = number > 0, number == len(wanted) - 1
        if not stretch.text:
            at = len(printed) if last and anywhere else at
            continue
        end = stretch.ends(printed, at, anywhere=anywhere, at_end=last)
        if end < 0:
            return f"expected: {stretch.text.strip()[:300]}\ngot: {printed[at:][:300].strip() or '(nothing more)'}"
        at = end
    return "" if at == len(printed) else f"expected: nothing more\ngot:\n    {printed[at:][:300].strip()}"


# ---- running --------------------------------------------------------------------------------------------------------


@dataclass
class Reader:
    """Runs the blocks of one page in a folder; `long` runs those that take long, too."""

    folder: Path
    long: bool = False
    namespace: types.ModuleType = field(default_factory=lambda: types.ModuleType("page"))

    def run(self, blocks: list[Block]) -> None:
        """Run all; the first that fails raises a BlockError with its place."""
        (self.folder / "sample_data").symlink_to(ROOT / "sample_data")
        before = Path.cwd()
        sys.modules["page"] = self.namespace  # dataclasses look their module up
        os.chdir(self.folder)
        sys.path.insert(0, str(self.folder))
        try:
            printed: str | None = None  # of the block before, None where it was not run
            for block in blocks:
                printed = self._step(block, printed)
        finally:
            os.chdir(before)
            sys.path.remove(str(self.folder))
            del sys.modules["page"]

    def _step(self, block: Block, printed: str | None) -> str | None:
        if block.language == "text" and not block.file:
            if block.follows and printed is not None:
                fault = difference(block.text, printed)
                if fault:
                    raise BlockError(f"{block.place}: the output is another\n{fault}")
            return None
        if block.not_run or (block.takes_long and not self.long):
            return None
        if block.file:
            path = Path(block.file)
            if path.is_absolute() or ".." in path.parts or path.parts[0] == "sample_data":
                raise BlockError(f"{block.place}: {block.file} is not in the reader's folder")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
            return None
        if block.language in NOT_SH:
            raise BlockError(f"{block.place}: write ```sh instead of ```{block.language}, so that it is run")
        if block.language == "sh":
            return self._sh(block)
        if block.language == "python":
            return self._python(block)
        return None

    def _python(self, block: Block) -> str:
        out = io.StringIO()
        try:
            code = compile("\n" * (block.line - 1) + block.text, str(block.page), "exec")
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
                exec(code, self.namespace.__dict__)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(block.page)]
            line = frames[-1].lineno if frames else getattr(error, "lineno", block.line)
            place = block.place.rpartition(":")[0]
            raise BlockError(
                f"{place}:{line}: expected: the block runs\ngot: {type(error).__name__}: {error}"
            ) from error
        return out.getvalue()

    def _sh(self, block: Block) -> str:
        printed = ""
        number = block.line
        lines = iter(block.text.splitlines())
        for line in lines:
            start = number
            number += 1
            while line.endswith("\\"):
                line = f"{line[:-1]} {next(lines, '').strip()}"
                number += 1
            if not line.strip() or line.strip().startswith("#"):
                continue
            place = f"{block.place.rpartition(':')[0]}:{start}"
            other = OTHER_EXIT.search(line)
            expected = int(other[1]) if other else 0
            code, text = self._command(line.strip().removeprefix("$ "), place)
            if code != expected:
                raise BlockError(
                    f"{place}: {line.strip()}\nexpected: exit code {expected}\n"
                    f"got: exit code {code}\n{text.strip()[-2000:]}"
                )
            printed += text
        return printed

    def _command(self, line: str, place: str) -> tuple[int, str]:
        line = re.sub(r"(?<![\w/])\./run(?=\s)", "inspector", line)
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        words = list(lexer)
        joined = [word for word in words if set(word) <= set("|&;<>()")]
        heads = [words[0]] + [words[i + 1] for i, w in enumerate(words[:-1]) if set(w) <= set("|&;")]
        for at, head in enumerate(heads):
            if head == "inspector":
                called = words[words.index(head, 0 if at == 0 else 1) + 1 :][:1]
                if called and called[0] in COMMANDS:
                    continue
                head = shlex.join(["inspector", *called])
            elif head in PROGRAMS or (head == "cd" and not joined):
                continue
            raise BlockError(
                f"{place}: `{head}` is not run by the tests; expected: one of `inspector COMMAND`, "
                f"{', '.join(sorted(PROGRAMS))}, or the line `% not run: reason` before the block"
            )
        if words[0] == "cd":
            os.chdir(words[1])
            return 0, ""
        if words[0] == "inspector" and not joined:
            return _in_process(words[1:])
        return _by_sh(line)


def _in_process(arguments: list[str]) -> tuple[int, str]:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code = main(arguments)
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue()


def _by_sh(line: str) -> tuple[int, str]:
    shim = f'inspector() {{ "{sys.executable}" -m inspector "$@"; }}\npython() {{ "{sys.executable}" "$@"; }}\n'
    done = subprocess.run(
        ["sh", "-c", shim + line],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    return done.returncode, done.stdout
