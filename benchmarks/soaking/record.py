"""Results of the cases, a line of JSON each, so that a run that was killed goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Result:
    """Result of one case; its input follows from the part's name, the seed and the number alone."""

    number: int
    kind: str  # of the input: "poses.csv", "arm", "slow headers" ...
    what: str = ""  # what was done to it, and by which command it was read
    end: str = ""  # "0", "1", "2", or the verdict of a diagnosis
    trouble: str = ""  # "traceback", "hang", "wrong" ...; "" where all is well
    said: str = ""  # the error line, the traceback, or what differs
    seconds: float = 0.0
    mb: float = 0.0  # the largest memory of the process meanwhile
    figures: dict[str, float] = field(default_factory=dict)  # what a part's own table is made of


class Record:
    """The results of one part so far, in a file that is only appended to."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.results: dict[int, Result] = {}
        for line in path.read_text("utf-8").splitlines() if path.exists() else []:
            try:
                result = Result(**json.loads(line))
            except (ValueError, TypeError):  # the last line of a run that was killed while it wrote
                continue
            self.results[result.number] = result  # a case that was run again counts as it was the last time

    def add(self, result: Result) -> None:
        """Keep one result."""
        self.results[result.number] = result
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result)) + "\n")

    def left(self, numbers: Iterable[int], *, retry: bool = False) -> list[int]:
        """Numbers of the cases that have not been run; with `retry` also of those that were in trouble."""
        return [n for n in numbers if n not in self.results or (retry and self.results[n].trouble)]

    def of(self, numbers: Iterable[int]) -> list[Result]:
        """The results of these cases."""
        return [self.results[n] for n in numbers if n in self.results]
