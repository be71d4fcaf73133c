"""The commands of a checkout, and what they answer."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0
MEMORY = 8 << 30  # bytes of address space that a command may take
LONGEST = 200  # of an answer that is printed


@dataclass(frozen=True)
class Outcome:
    """What came of one command."""

    code: int | None  # None: it was still running when patience ended
    out: str
    err: str
    seconds: float

    @property
    def is_refused(self) -> bool:
        """Ended by itself with an error of one or more lines, none of them a traceback."""
        return self.code in (1, 2) and not self.is_broken

    @property
    def is_broken(self) -> bool:
        """A crash, a hang or a traceback."""
        texts = ("Traceback (most recent call last)", "terminate called", "Sanitizer")
        killed = self.code is None or self.code < 0
        return killed or any(text in self.err for text in texts)

    @property
    def said(self) -> str:
        """How it ended, in one short line without the names of temporary folders."""
        if self.code is None:
            return f"still running after {PATIENCE_S:.0f} s"
        if self.code < 0:
            return f"ended by {signal.Signals(-self.code).name}"
        lines = [line for line in self.err.splitlines() if line.strip()]
        text = lines[-1] if lines else "no message"
        if "Traceback (most recent call last)" in self.err:
            text = f"traceback: {text}"
        text = re.sub(r"\S*/doors_\w+/", "", text)
        return f"exit {self.code}: {text}"[:LONGEST]


@dataclass(frozen=True)
class Checkout:
    """A built source tree: its binary and its Python."""

    root: Path

    @property
    def configs(self) -> Path:
        return self.root / "configs"

    def infrasim(self, *words: object, **how: Any) -> Outcome:
        return self._run([self.root / "build/dev/cpp/infrasim", *words], **how)

    def pyinfra(self, *words: object, **how: Any) -> Outcome:
        return self._run([self.root / ".venv/bin/python", "-m", "pyinfra", *words], **how)

    def python(self, code: str, **how: Any) -> Outcome:
        return self._run([self.root / ".venv/bin/python", "-c", code], **how)

    def start(self, *words: object) -> subprocess.Popen[str]:
        """The binary, running."""
        command = [str(w) for w in (self.root / "build/dev/cpp/infrasim", *words)]
        return subprocess.Popen(
            command, cwd=self.root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def _run(self, command: list[object], patience_s: float = PATIENCE_S) -> Outcome:
        def limits() -> None:
            os.setsid()
            if ".venv" not in str(command[0]):  # PyTorch reserves more than it takes
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))

        start = time.perf_counter()
        process = subprocess.Popen(
            [str(word) for word in command],
            cwd=self.root,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            preexec_fn=limits,
        )
        try:
            out, err = process.communicate(timeout=patience_s)
            code: int | None = process.returncode
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
            code = None
        return Outcome(code, out, err, time.perf_counter() - start)
