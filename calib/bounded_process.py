"""A function of this library, run on an untrusted file in a process of its own with bounded memory, time and output.

Parsers that others wrote (MuJoCo, readers of bags) may be led to ask for any amount of memory, to run for ever or to
crash. In a process of their own that ends the process and becomes one line; the program that asked goes on. The process
has no environment but what is listed here, starts no debugger, leaves no core file and writes nothing but its answer.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

_GRACE_S = 5.0  # for the start and the imports, in addition to the time of the work
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True)
class ProcessLimits:
    """Limits of one request in a bounded process: processor time, memory, size of the answer."""

    seconds: float = 30.0
    memory_bytes: int = 1024**3  # in addition to what the imports take
    answer_bytes: int = 128 * 1024**2


class ProcessFailed(Exception):
    """Error of a process that gave no answer; its text says why, without the file's name."""


def ask(function: str, request: Mapping[str, Any], limits: ProcessLimits = ProcessLimits()) -> Any:
    """Answer of `function` ("package.module:name") to a request, worked out in a bounded process; both are JSON.

    The function may have a companion `prepare` in its module, called before the limits hold: for imports. Raises
    ProcessFailed.
    """
    question = {
        "path": [str(Path(entry or ".").resolve()) for entry in sys.path],
        "function": function,
        "limits": asdict(limits),
        "request": dict(request),
    }
    windows = {key: os.environ[key] for key in ("SYSTEMROOT",) if key in os.environ}
    with tempfile.TemporaryDirectory(prefix="bounded-") as folder, tempfile.TemporaryFile() as out:
        process = subprocess.Popen(
            [sys.executable, "-I", "-B", str(Path(__file__))],
            stdin=subprocess.PIPE,
            stdout=out,  # a file, not a pipe: the limit on the size of files holds for it
            stderr=subprocess.DEVNULL,
            cwd=folder,
            env=_ENVIRONMENT | windows,
        )
        try:
            process.communicate(json.dumps(question).encode(), timeout=limits.seconds + _GRACE_S)
        except subprocess.TimeoutExpired:
            raise ProcessFailed(f"is not done after {limits.seconds:g} s") from None
        finally:
            process.kill()
            process.wait()
        out.seek(0)
        text = out.read(limits.answer_bytes + 1)
    try:
        answer = json.loads(text)
    except ValueError:
        answer = None
    if not isinstance(answer, dict) or "answer" not in answer:
        raise ProcessFailed(how_it_ended(process.returncode, limits, answer))
    return answer["answer"]


def how_it_ended(code: int, limits: ProcessLimits, answer: Any = None) -> str:
    """Reason why a process gave no answer, from its exit code and output, as the end of a sentence about the file."""
    if isinstance(answer, dict) and "failed" in answer:
        return str(answer["failed"])
    if code in (-24, -9):  # SIGXCPU, and SIGKILL behind it
        return f"is not done after {limits.seconds:g} s"
    return f"ended its reader (exit code {code}): it asks for too much memory, or is damaged"


def main() -> None:
    """Entry point of the bounded process: read a request from stdin, answer it within the limits on stdout."""
    question = json.loads(sys.stdin.buffer.read())
    answer_to = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    sys.path[:] = question["path"]
    limits = ProcessLimits(**question["limits"])
    module_name, _, name = question["function"].partition(":")
    module = importlib.import_module(module_name)
    getattr(module, "prepare", lambda: None)()
    bound_this_process(limits)
    try:
        text = json.dumps({"answer": getattr(module, name)(question["request"])}).encode()
        if len(text) > limits.answer_bytes:
            text = json.dumps({"failed": f"makes more than {limits.answer_bytes // 1024**2} MB"}).encode()
    except MemoryError:
        text = json.dumps({"failed": f"needs more than {limits.memory_bytes // 1024**2} MB of memory"}).encode()
    answer_to.write(text)
    answer_to.flush()
    os._exit(0)  # what is left to close may be refused by now


def bound_this_process(limits: ProcessLimits) -> None:
    """Limit this process's further memory and time and the size of its files, as far as the system can."""
    try:
        import resource
    except ImportError:  # Windows: the time alone is bounded, by whoever asks
        return
    try:
        pages = Path("/proc/self/statm").read_text("ascii").split()[0]
        now_bytes = int(pages) * resource.getpagesize()
    except (OSError, ValueError):
        now_bytes = 4 * 1024**3
    used_s = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    for kind, most in (
        (resource.RLIMIT_AS, now_bytes + limits.memory_bytes),
        (resource.RLIMIT_CPU, math.ceil(used_s + limits.seconds)),
        (resource.RLIMIT_FSIZE, limits.answer_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        try:
            resource.setrlimit(kind, (most, most))
        except (OSError, ValueError):  # macOS knows RLIMIT_AS and refuses it
            continue


if __name__ == "__main__":
    main()
