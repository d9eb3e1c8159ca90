"""What can go wrong, for two hours every night: each part is drawn from a seed, and told where a promise was broken.

    python benchmarks/soak.py [--only inputs|arms|constraints|clients|page|killed] [--scale 0.01] [--seed 18] [--jobs 2]

inputs       tests/test_hostile_inputs.py with thousands of examples in place of dozens: spoiled files through the
             commands, files that mean what they meant, fits of the same arm told otherwise
arms         1,000 random arms from calib/simulation/truth, diagnosed: errors against the bound, names against the truth
constraints  4,000 random arms measured by sockets, planes and bars: no fit that lost the arm's size is accepted
clients      hostile clients at a live server, one by one and all at once, beside an honest page
page         1,000 clicks and keys anywhere on the page in two browsers, one of which is killed and opened anew in the
             middle: nothing fails, and after a fifth of them the server's memory stays within 20 %
killed       a writer of sessions and a server that imports are killed (SIGKILL) at random moments: every session and
             dataset can be opened, and nothing is left over

A case follows from its part, the seed and its number alone. Exit code 1 where anything was wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import urllib.request
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NoReturn

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import msgspec
import numpy as np
import viser
from playwright.sync_api import sync_playwright
from simulated import heavy_arm, scara, ur10e
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import diagnose
from calib.calibration.result import Calibration
from calib.dataset.files.atomic_write import write_all_atomically
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import CATALOGUE
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD
from calib.errors import CalibError
from calib.kinematics.chain import target_jacobian, target_points
from calib.kinematics.robot import Robot
from calib.present.fit.calibration import calibration_warnings
from calib.simulation.simulate import Simulation, simulate_dataset
from calib.simulation.truth.arm_sampling import Tolerances
from inspector.panels.your_data import OPEN, OWN_DATA
from inspector.session.measuring import open_session
from inspector.session.session_file import session_text
from inspector.session.transitions import with_calibration
from tests.support import ROOT
from tests.support.arms import random_arm
from tests.support.browser import COARSE, FLAGS, need_chromium
from tests.support.constrained_arms import accepted_collapse
from tests.support.promises import files_below
from tests.support.wire_client import WireClient

COUNTS = {"inputs": 3000, "arms": 1000, "constraints": 4000, "clients": 1, "page": 1000, "killed": 300}
DATASET = ROOT / "sample_data" / "hidden_effect_b"
CASE_S = 300  # for one arm, on a machine that others use too
MOST_SHARE = 0.03  # of the arms: wrong names, and causes passed over, which any test at a level has
Troubles = list[str]


# ---- spoiled inputs -------------------------------------------------------------------------------------------------


def soak_inputs(count: int, options: argparse.Namespace) -> Troubles:
    """The hypothesis tests with so many examples each."""
    command = [sys.executable, "-m", "pytest", "-q", "-m", "", "-n", str(options.jobs), "--timeout", "0",
               f"--hypothesis-seed={options.seed}", "tests/test_hostile_inputs.py"]  # fmt: skip
    environment = {**os.environ, "HOSTILE_EXAMPLES": str(max(1, count // 10))}
    return ["see above"] if subprocess.run(command, cwd=ROOT, env=environment).returncode else []


# ---- random arms ----------------------------------------------------------------------------------------------------

TESTABLE = tuple(kind.name for kind in CATALOGUE if kind.testable)
HIDDEN_SHARE = (0.4, 0.45, 0.15)  # of the arms have no, one, two effects
NEAR = 1.5  # times the bound: 20 test poses have an RMS within 35 % of it in 999 of 1,000 arms
TOLD = "the test poses are off by"  # as where the one before a step, of which no training pose tells, is a test pose
SATISFIED = ("adequate", "named")


@dataclass(frozen=True)
class DrawnArm:
    """A simulated cell, what is hidden in it, and the noise of its points."""

    effects: tuple[str, ...]
    noise_mm: float
    simulation: Simulation


def _robot(rng: np.random.Generator) -> Robot:
    kind = int(rng.integers(8))
    if kind < 5:
        return heavy_arm(kind, rng)[1]
    joints = int(rng.integers(4, 8))
    return (ur10e(), scara(), random_arm(rng, joints, prismatic=int(rng.integers(joints))))[kind - 5]


def draw(number: int, seed: int) -> DrawnArm:
    """The arm of this number. What its robot cannot have is drawn anew, at the most until nothing is hidden."""
    for attempt in range(8):
        rng = np.random.default_rng([seed, 3, number, attempt])
        robot = _robot(rng)
        count = int(rng.choice(3, p=HIDDEN_SHARE)) if attempt < 7 else 0
        effects = [(str(name), float(rng.uniform(2, 8))) for name in rng.choice(TESTABLE, count, replace=False)]
        noise_mm = float(np.exp(rng.uniform(np.log(0.02), np.log(0.15))))
        size = float(rng.choice([0.5, 1.0, 3.0]))
        with contextlib.suppress(CalibError):
            made = simulate_dataset(
                robot,
                rng=rng,
                effects=effects,
                conditions=bool(rng.integers(2)) or None,
                poses=int(rng.integers(50, 110)),
                noise_mm=noise_mm,
                setups=int(rng.choice([1, 1, 1, 2])),
                tolerances=Tolerances(0.3 * size, 0.1 * size),
            )
            dataset = replace(made.dataset, scanner=replace(made.dataset.scanner, point_sigma_mm=noise_mm))
            return DrawnArm(made.truth.effect_names, noise_mm, replace(made, dataset=dataset))
    raise AssertionError(f"arm {number}: nothing could be simulated")


def bound_mm(arm: DrawnArm) -> float:
    """The Cramer-Rao bound of the held-out 3D RMS error of a fit of link errors alone, at the true arm.

    The measured points' own noise counts in it: sqrt(3 s^2 + mean trace of the predictions' covariance), the scanner's
    frames unknown, the parameters held as softly as the fit holds them.
    """
    dataset, robot = arm.simulation.dataset, arm.simulation.truth.robot
    assert dataset.points is not None
    pose = dataset.points.pose
    places, setup = np.unique(dataset.poses.setup[pose], return_inverse=True)
    by_frames = np.zeros((len(pose), 3, 6 * len(places)))
    for k, (x, y, z) in enumerate(np.asarray(target_points(robot, dataset.poses.q))[pose] / 1e3):
        turn = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        by_frames[k, :, 6 * setup[k] : 6 * setup[k] + 6] = np.hstack([np.eye(3), turn])
    test = dataset.poses.is_test[pose]
    scale = np.tile([TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_RAD], robot.n_joints + 1)
    jacobian = np.concatenate([target_jacobian(robot, dataset.poses.q)[pose], by_frames], axis=2)
    rows = jacobian[~test].reshape(-1, jacobian.shape[2]) / arm.noise_mm
    known = np.concatenate([1 / scale**2, np.full(by_frames.shape[2], 1e-12)])
    covariance = np.linalg.inv(rows.T @ rows + np.diag(known))
    predicted = np.einsum("nip,pq,niq->n", jacobian[test], covariance, jacobian[test])
    return float(np.sqrt(3 * arm.noise_mm**2 + predicted.mean()))


def diagnosed(number: int, seed: int) -> str:
    """The worst that is wrong with the diagnosis of one arm; "" where nothing is."""
    arm = draw(number, seed)
    found = diagnose(arm.simulation.dataset)
    bound = bound_mm(arm)
    trouble = judged(arm, found, bound)
    told = f"{found.verdict} {', '.join(found.missing)} ({', '.join(arm.effects)}), bound {bound:.3g} mm"
    return trouble and f"{trouble}: {told}"


def judged(arm: DrawnArm, found: Diagnosis, bound: float) -> str:
    """What is wrong with a diagnosis: a fit that is worse than it says, a name that is untrue, a cause passed over."""
    for step in found.steps:
        result = step.calibration
        assert result.before.test is not None
        if not np.all(np.isfinite([_test_mm(result), result.before.test.rmse_mm, *result.fit.x])):
            return "not finite"
        if not result.fit.converged and not calibration_warnings(result):
            return "no convergence, not told"
        if _test_mm(result) > result.before.test.rmse_mm and result.worsening is None:
            return "worse than nominal, not told"
    if set(found.missing) - set(arm.effects):
        return "wrong name"
    quiet = found.verdict in SATISFIED and not calibration_warnings(found.calibration) and TOLD not in found.summary()
    if quiet and _test_mm(found.calibration) > NEAR * bound:
        return "passed over" if set(found.missing) < set(arm.effects) else "far from the bound, not told"
    return ""


def _test_mm(result: Calibration) -> float:
    assert result.after.test is not None
    return result.after.test.rmse_mm


def _too_long(*_: object) -> NoReturn:
    raise TimeoutError(f"no answer in {CASE_S} s")


def one_case(case: tuple[Callable[[int, int], str], int, int]) -> str:
    """Trouble of one case, an exception or a hang among them."""
    judge, number, seed = case
    signal.signal(signal.SIGALRM, _too_long)
    signal.alarm(CASE_S)
    try:
        trouble = judge(number, seed)
    except Exception:
        trouble = traceback.format_exc()[-2000:]
    finally:
        signal.alarm(0)
    return trouble and f"{number}: {trouble}"


def soak_cases(judge: Callable[[int, int], str], count: int, options: argparse.Namespace) -> Troubles:
    """Trouble of the cases 0 to `count`, on processes."""
    cases = [(judge, number, options.seed) for number in range(count)]
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn"), max_tasks_per_child=100) as pool:
        return [trouble for trouble in pool.map(one_case, cases) if trouble]


def soak_arms(count: int, options: argparse.Namespace) -> Troubles:
    """Diagnoses of random arms; few wrong names and passed over causes are no trouble."""
    found = soak_cases(diagnosed, count, options)
    counted = Counter(word for trouble in found for word in ("wrong name", "passed over") if f": {word}: " in trouble)
    print(f"arms: {dict(counted)} of {count}, {MOST_SHARE:.0%} of each allowed")
    few = {word for word, times in counted.items() if times <= max(1.0, MOST_SHARE * count)}
    return [trouble for trouble in found if not any(f": {word}: " in trouble for word in few)]


def soak_constraints(count: int, options: argparse.Namespace) -> Troubles:
    """Arms measured by constraints."""
    return soak_cases(accepted_collapse, count, options)


# ---- hostile clients ------------------------------------------------------------------------------------------------

HOST, SUBPROTOCOL = "127.0.0.1", f"viser-v{viser.__version__}"
SPAN_S = 10.0  # that a slow client goes on
SETTLE_S, ANSWER_S = 90.0, 10.0  # until an attack is over; until the page comes then
MORE_MB = 350.0  # that the server may have more than before all attacks: it grows no further from then on
UPGRADE = (
    f"GET / HTTP/1.1\r\nHost: {HOST}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n"
).encode()
SAID = (
    b"", os.urandom(400), b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", UPGRADE[:40], UPGRADE[:-2],
    b"GET /" + b"a" * 10_000_000 + b" HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000 + b"\r\n",
    b"GET / HTTP/1.1\r\nX: " + b"a" * 10_000_000 + b"\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(50),
    *(method + b" / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n\r\nhello" for method in (b"POST", b"TRACE", b"\xff")),
)  # fmt: skip
PATHS = (
    "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..%2f..%2fetc/passwd", "/.git/config",
    "/inspector/../../pyproject.toml", "/%00", "/" + "a/" * 5000, "http://[::1", "/" + "%ff" * 100,
    "/inspector/ask?name=pose&value=" + "9" * 900, "/inspector/ask?name=joint&value=1e999", "/inspector/ask?",
)  # fmt: skip


@contextlib.contextmanager
def call(port: int, *, reset: bool = False) -> Iterator[socket.socket]:
    """A connection; what it breaks off with is not told."""
    with socket.create_connection((HOST, port), 10.0) as caller:
        caller.settimeout(5.0)
        with contextlib.suppress(OSError):
            yield caller
            if reset:  # the next close sends RST, not FIN
                caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def say(port: int, words: bytes, *, reset: bool = False) -> bytes:
    """Say this, and take what is answered, if it is waited for."""
    answer = b""
    with call(port, reset=reset) as caller:
        caller.sendall(words)
        if not reset:
            caller.shutdown(socket.SHUT_WR)
            while len(answer) < 10_000_000 and (part := caller.recv(65536)):
                answer += part
    return answer


def rubbish(port: int) -> None:
    """What is no request, too long, or broken off, each closed and reset."""
    for k in range(20 * len(SAID)):
        said = SAID[k % len(SAID)]
        if len(said) < 10_000 or k < 2 * len(SAID):
            say(port, said, reset=bool(k // len(SAID) % 2))


def foreign_files(port: int) -> None:
    """Files that are none of a page's business, and questions that its own script would never ask."""
    for path in PATHS:
        answer = say(port, f"GET {path} HTTP/1.1\r\nHost: {HOST}:{port}\r\nX-Inspector: 1\r\n\r\n".encode())
        assert b"root:" not in answer, path
        assert b"[core]" not in answer, path


def foreign_pages(port: int) -> None:
    """Pages of elsewhere in the user's browser, and foreign names that someone points at this machine."""
    for origin in ("http://evil.example", f"http://{HOST}.evil.example:{port}", "null", f"http://{HOST}:{port + 1}"):
        let_in = False
        with (
            contextlib.suppress(InvalidStatus, OSError),
            connect(f"ws://{HOST}:{port}", subprotocols=[SUBPROTOCOL], origin=origin),  # type: ignore[list-item,arg-type]
        ):
            let_in = True
        assert not let_in, f"a page of {origin} was let in"
    for host in ("evil.example", "127.0.0.1.nip.io", "", "[", "a" * 300, "127.0.0.1:99999999"):
        said = f"GET / HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\r\n"
        assert not say(port, said.encode()).startswith(b"HTTP/1.1 200"), host


def slow_and_many(port: int) -> None:
    """Fifteen hundred connections, more than a process may have open files as a rule, some of which drip headers."""
    callers, end = [], time.monotonic() + 2 * SPAN_S
    while len(callers) < 1500 and time.monotonic() < end:
        with contextlib.suppress(OSError):
            callers.append(socket.create_connection((HOST, port), 8.0))
    for words in (b"GET / HTTP/1.1\r\n", *[b"X-a: b\r\n"] * int(SPAN_S)):
        for caller in callers[::15]:
            with contextlib.suppress(OSError):
                caller.sendall(words)
        time.sleep(1.0)
    for caller in callers:
        caller.close()


def _frame(opcode: int, body: bytes, *, fin: bool = True, mask: bool = True, length: int | None = None) -> bytes:
    size = len(body) if length is None else length
    bit = 0x80 if mask else 0
    head = bytes([(0x80 if fin else 0) | opcode, bit | (size if size < 126 else 127)])
    return head + (struct.pack(">Q", size) if size >= 126 else b"") + (b"\0\0\0\0" if mask else b"") + body


def broken_frames(port: int) -> None:
    """Frames of a told length beyond all bounds, a message that never ends, and frames that RFC 6455 forbids."""
    for frames in (
        *([_frame(2, b"x" * 1000, length=length)] for length in (2**62, 2**63, 2**40, 2**31)),
        [_frame(2, b"x" * 1_000_000, fin=False), *[_frame(0, b"x" * 1_000_000, fin=False)] * 150],
        [_frame(2, b"hello", mask=False)],
        [_frame(opcode, b"") for opcode in (3, 7, 11, 15)],
        [_frame(9, b"x" * 200)],
        [_frame(0, b"goes on")],
        [_frame(1, b"\xff\xfe")],
        [_frame(8, struct.pack(">H", 9999))],
        [_frame(9, b"")] * 20_000,
    ):
        with call(port) as caller:
            caller.sendall(UPGRADE)
            caller.recv(65536)
            for frame in frames:
                caller.sendall(frame)
            caller.settimeout(0.3)
            while caller.recv(65536):
                pass


def unsound_messages(port: int) -> None:
    """Bytes that are no msgpack, and messages of every kind that viser knows with fields missing or absurd."""
    from viser import _messages

    odd: list[Any] = [None, -1, 1e308, float("nan"), "x" * 5000, [], {}, [[1]], b"\xff", True, "../../etc/passwd"]
    rng = np.random.default_rng(1)
    said: list[bytes | str] = [b"", b"\xc1\xff" * 30, "text", b"\xdf\xff\xff\xff\xff", b"\x91" * 100_000, rng.bytes(99)]
    for kind in (name for name in dir(_messages) if name.endswith("Message")):
        fields = getattr(getattr(_messages, kind), "__annotations__", {})
        values = {name: odd[int(rng.integers(len(odd)))] for name in fields}
        said += [msgspec.msgpack.encode({"type": kind}), msgspec.msgpack.encode({**values, "type": kind})]
    for piece in said:
        with (
            contextlib.suppress(Exception),
            connect(f"ws://{HOST}:{port}", subprotocols=[SUBPROTOCOL], max_size=None) as page,  # type: ignore[list-item]
        ):
            page.send(piece)
            page.recv(timeout=0.1)


def wrong_values(port: int) -> None:
    """Values that no widget of the page can have, uploads that lie, and twenty thousand moves at once."""
    rng = np.random.default_rng(2)
    odd = [9999, -1, "../../../etc/passwd", "<img src=x>", None, [], {"value": 1}, float("nan"), "x" * 5000, b"\0"]
    uploads = (("../../evil.zip", 4, 1), ("a.zip", 10**15, 2), ("a.zip", -5, 1), ("", 4, 10**9), ("x" * 5000, 4, 0))
    with WireClient(port) as page:
        for uuid in list(page.gui):
            for k in rng.permutation(len(odd))[:4]:
                page.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": odd[int(k)]})
            page.send(type="GuiUpdateMessage", uuid=uuid, updates={"label": "evil", "visible": False})
        buttons = [u for u, m in page.gui.items() if "upload" in m["type"].lower()]
        assert buttons, "the page has no button to send files by"
        for number, (name, size, parts) in enumerate(uploads):
            these = {"source_component_uuid": buttons[0], "transfer_uuid": f"u{number}"}
            told = {"filename": name, "mime_type": "x", "part_count": parts, "size_bytes": size}
            page.send(type="FileTransferStartUpload", **these, **told)
            for index in (1, 0, 0, -1, 10**9):
                page.send(type="FileTransferPart", **these, part_index=index, content=b"evil")
        for k in range(20_000):
            page.send(type="GuiUpdateMessage", uuid=f"{k}", updates={"value": k})
        time.sleep(1.0)


def vanishing_pages(port: int) -> None:
    """Pages that are gone before they have seen anything, and some that ask for everything and read nothing."""
    deaf = [socket.create_connection((HOST, port), 10.0) for _ in range(20)]
    for caller in deaf:
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        caller.sendall(UPGRADE)
    for k in range(150):
        with call(port, reset=True) as caller:
            caller.sendall(UPGRADE)
            if k % 3:
                caller.recv(65536 * (k % 3))
    for caller in deaf:
        caller.close()


ATTACKS = (rubbish, foreign_files, foreign_pages, slow_and_many, broken_frames, unsound_messages, wrong_values,
           vanishing_pages)  # fmt: skip


class LiveServer:
    """`inspector serve FOLDER/served --data FOLDER/data`; home, temporary and working folder lie below FOLDER too."""

    def __init__(self, folder: Path, data: Path | None = None) -> None:
        for name in ("home", "tmp", "cwd"):
            (folder / name).mkdir(parents=True)
        shutil.copytree(DATASET, folder / "served" / DATASET.name)
        self.folder, self.log = folder, folder.with_suffix(".log")
        environment = {**os.environ, "HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp"),
                       "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
        command = [sys.executable, "-u", "-m", "inspector", "serve", folder / "served", "--port", "0", "--data",
                   data or folder / "data"]  # fmt: skip
        self.process = subprocess.Popen(
            [*map(str, command)], stdout=self.log.open("wb"), stderr=subprocess.STDOUT, cwd=folder / "cwd",
            env=environment, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (1024, 1024)),
        )  # fmt: skip
        while not (found := re.search(r"Open http://127\.0\.0\.1:(\d+)", self.said())):
            assert self.process.poll() is None, self.said()
            time.sleep(0.1)
        self.port, self.before = int(found[1]), files_below(folder)

    def said(self) -> str:
        """Everything that the server printed."""
        return self.log.read_text("utf-8", "replace")

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()

    def processor_s(self) -> float:
        """Processor time that it has taken."""
        spent = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        return sum(map(int, spent)) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self) -> float:
        """Resident memory."""
        return int(Path(f"/proc/{self.process.pid}/status").read_text().split("VmRSS:")[1].split()[0]) / 1024

    def trouble(self, first_mb: float) -> str:
        """What an attack has left; "" where nothing is."""
        if self.process.poll() is not None or "Traceback" in self.said():
            return f"died or a traceback: {self.said()[-2000:]}"
        began = time.monotonic()
        try:
            urllib.request.urlopen(f"http://{HOST}:{self.port}/", timeout=60.0).read()
        except OSError as error:
            return f"the page does not come: {error}"
        if time.monotonic() - began > ANSWER_S:
            return f"the page comes in {time.monotonic() - began:.0f} s"
        if files_below(self.folder) != self.before:
            return "files are new, gone or changed"
        return "memory" if self.memory_mb() > first_mb + MORE_MB else ""


def _turns(page: WireClient, poses: Sequence[str]) -> bool:
    """Whether an honest page is shown each of three poses that it asks for."""
    for number in (2, 3, 1):
        with contextlib.suppress(AssertionError):
            page.set("Pose", poses[number - 1])
            page.wait(lambda p, number=number: f"{number} of {len(poses)}" in p.text(), 60.0)
            continue
        return False
    return True


def soak_clients(count: int, options: argparse.Namespace) -> Troubles:
    """Each attack, then all at once, at one server with an honest page."""
    found: Troubles = []

    def attacked(attack: Callable[[int], None]) -> None:
        try:
            attack(server.port)
        except AssertionError as error:  # a door that stood open
            found.append(f"{attack.__name__}: {error}")
        except OSError:
            pass  # beside a flood of connections an attack may be refused

    with tempfile.TemporaryDirectory() as folder:
        server = LiveServer(Path(folder) / "server")
        try:
            with WireClient(server.port) as page:
                page.wait(lambda p: p.has("Pose") and len(p.props("Pose")["options"]) > 1, 120.0)
                poses = list(page.props("Pose")["options"])
                page.wait(lambda p: "What could be missing:" in p.text(), 180.0)
                attacked(rubbish)  # loads what is only loaded where something is refused
                first_mb = server.memory_mb()
                for attacks in (*((attack,) for attack in ATTACKS), ATTACKS):
                    threads = [threading.Thread(target=attacked, args=(attack,), daemon=True) for attack in attacks]
                    for thread in threads:
                        thread.start()
                    for thread in threads:
                        thread.join(CASE_S)
                    end = time.monotonic() + SETTLE_S
                    while (trouble := server.trouble(first_mb)) and time.monotonic() < end:
                        time.sleep(1.0)
                    trouble = trouble or ("" if _turns(page, poses) else "the honest page is not served")
                    name = attacks[0].__name__ if len(attacks) == 1 else "all at once"
                    print(f"clients: {name}: {trouble or 'served'}, {server.memory_mb():.0f} MB", flush=True)
                    found += [f"{name}: {trouble}"] if trouble else []
        finally:
            server.process.terminate()
            server.process.wait(30)
    return found


# ---- a page for a long time -----------------------------------------------------------------------------------------


CLICK = """k => {
  const all = [...document.querySelectorAll('button, [role="tab"], tr[data-value], [data-ask], input[type="checkbox"]')]
    .filter(node => node.offsetParent !== null && !node.disabled)
  all[k % all.length].click()
}"""
KEYS = ("n", "p", "1", "2", "3", "4", "5", "6", "f", "s", "t", "r", "d", "Control+z", "Control+y", "Escape")
FLAT, WARM = 1.2, 0.2  # largest memory over that after this share of the operations


def settled_mb(server: LiveServer) -> float:
    """Memory of a server once it has nothing left to do."""
    spent = -1.0
    while (now := server.processor_s()) > spent + 0.1:
        spent = now
        time.sleep(2.0)
    return server.memory_mb()


def soak_page(count: int, options: argparse.Namespace) -> Troubles:
    """Random clicks and keys in two browsers by turns."""
    rng, found, memory = np.random.default_rng(options.seed), list[str](), list[float]()

    def opened() -> tuple[Any, Any]:
        browser = chromium.launch(executable_path=need_chromium(), args=list(FLAGS))
        page = browser.new_page()
        page.on("pageerror", lambda error: found.append(f"on the page: {error.stack}"))
        page.goto(f"http://{HOST}:{server.port}/?fixedDpr={COARSE}")
        page.get_by_role("tab", name="Measure").wait_for(timeout=300_000)
        return browser, page

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        server, chromium = LiveServer(Path(folder) / "server"), playwright.chromium
        try:
            browsers = [opened(), opened()]
            for number in range(count):
                if number == count // 2:
                    told = browsers[1][0].new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
                    os.kill(next(process["id"] for process in told if process["type"] == "browser"), signal.SIGKILL)
                    browsers[1] = opened()
                page = browsers[number % 2][1]
                if rng.random() < 0.5:
                    page.evaluate(CLICK, int(rng.integers(2**30)))
                else:
                    page.keyboard.press(str(rng.choice(KEYS)))
                time.sleep(0.05)
                if (number + 1) % max(1, round(WARM / 2 * count)) == 0:
                    memory.append(settled_mb(server))
                    print(f"page: {number + 1} operations, {memory[-1]:.0f} MB", flush=True)
            trouble = server.trouble(server.memory_mb())
            found += [trouble] if trouble else []
        finally:
            server.kill()
    most = max(memory[1:]) / memory[1]
    return [*found, *([f"memory grew to {most:.2f} times"] if most > FLAT else [])]


# ---- killed at random moments ---------------------------------------------------------------------------------------


def soak_killed(count: int, options: argparse.Namespace) -> Troubles:
    """Writers of a session that are killed, and a server for each twenty of them that is killed while it imports."""
    rng, found = np.random.default_rng(options.seed), list[str]()
    session = with_calibration(open_session(DATASET))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        path, server_folder, archive = folder / "session.json", folder / "server", folder / "cell.zip"
        text = session_text(session, beside=folder)
        for _ in range(count):
            writer = os.fork()
            while not writer:
                write_all_atomically({path: text, folder / "beside.json": text})
            time.sleep(float(rng.uniform(0.0, 0.03)))
            os.kill(writer, signal.SIGKILL)
            os.waitpid(writer, 0)
            with contextlib.suppress(FileNotFoundError):
                found += [] if path.read_text("utf-8") == text else ["a session is damaged"]
        with zipfile.ZipFile(archive, "w") as packed:
            for file in DATASET.iterdir():
                packed.write(file, file.name)
            packed.writestr("session.json", text)
        imported = 0
        for number in range(count // 20):
            server = LiveServer(server_folder / str(number), data=server_folder / "data")
            with WireClient(server.port) as page, contextlib.suppress(AssertionError):
                page.upload(OWN_DATA, archive.name, archive.read_bytes())
                page.wait(lambda p: p.has(OPEN) and not p.props(OPEN)["disabled"], 60.0)
                page.click(OPEN)
                time.sleep(float(rng.uniform(0.0, 1.0)))
                server.process.kill()
            server.kill()
            for dataset in (server_folder / "data").glob("[!.]*"):
                load_dataset(dataset)
            imported = len(list((server_folder / "data").glob("[!.]*")))
        server = LiveServer(server_folder / "last", data=server_folder / "data")
        left = [path.name for path in (server_folder / "data").glob(".*")]
        server.kill()
    print(f"killed: {imported} of {count // 20} imports had ended, left over: {left}")
    return [*found, *(f"left over: {name}" for name in left)]


PARTS: dict[str, Callable[[int, argparse.Namespace], Troubles]] = {
    "inputs": soak_inputs, "arms": soak_arms, "constraints": soak_constraints, "clients": soak_clients,
    "page": soak_page, "killed": soak_killed,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the parts and tell; 1 where anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=[*PARTS], help="this part; may be given several times")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the cases")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--seed", type=int, default=18)
    options = parser.parse_args(arguments)
    good = True
    for part in options.only or PARTS:
        began = time.monotonic()
        count = max(1, round(COUNTS[part] * options.scale))
        found = PARTS[part](count, options)
        print(f"{part}: {count} cases, {len(found)} in trouble, {(time.monotonic() - began) / 60:.1f} min", flush=True)
        print("".join(f"  {trouble}\n" for trouble in found[:100]), end="")
        good = good and not found
    print("all is well" if good else "NOT all is well")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
