"""The answers of a service, a line each as they arrive, so that no question is asked twice.

`answers.jsonl` while an evaluation runs, `answers.jsonl.xz` once it is complete. Before the answers
of each session stands a line that says which service gave them. A line that a crash cut short is
dropped when the log is opened again.
"""

import fcntl
import json
import lzma
import shutil
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, Self

from pydantic import BaseModel

from app.evaluation.question import Question, key_of

TRAJECTORIES = frozenset({"controls", "states", "candidates"})


class EvaluationError(Exception):
    """The evaluation cannot go on: its log is damaged, in use or another's, or no model fits."""


class Session(BaseModel):
    """Who answered, when, and how many requests were under way at once.

    Not the wire's own description of a service: that one grows, and old logs would not be read.
    """

    began: datetime
    version: str
    """Of the service."""
    machine: str
    device: str
    """Of the network."""
    network_threads: int
    libraries: dict[str, str]
    """Version by name."""
    models: dict[str, str]
    """The sha256 of each model by its name/version."""
    concurrency: int


class Answer(NamedTuple):
    """What the service answered, and how long the client waited for it."""

    content: Mapping[str, Any]
    """The answer's JSON, without trajectories unless the question wanted them."""
    latency_ms: float

    @property
    def model(self) -> str | None:
        """Name/version of the learned model that answered, if one did."""
        model = self.content.get("model")
        return model and f"{model['name']}/{model['version']}"

    @property
    def compute_ms(self) -> float:
        """The service's own time, waiting apart."""
        timing = self.content["timing_ms"]
        return float(timing["total"] - timing["queue"])


class AnswerLog:
    """The answers kept in a folder; a context manager that holds the folder for itself.

    Args:
        directory: where the log is, or shall be.

    Raises:
        EvaluationError: it is damaged, or another evaluation is writing to it.
        OSError: the folder cannot be written to.
    """

    def __init__(self, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._path = directory / "answers.jsonl"
        self._packed = directory / "answers.jsonl.xz"
        if self._packed.exists() and not self._path.exists():
            try:
                _replace(self._packed, self._path, unpack=True)
            except (lzma.LZMAError, EOFError) as error:
                raise EvaluationError(f"{self._packed} is damaged: {error}") from None
        self.sessions: list[Session] = []
        self._answers: dict[str, Answer] = {}
        self._uncovered: set[str] = set()
        self._file = self._path.open("ab+", buffering=0)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._read()
        except BlockingIOError:
            self._file.close()
            raise EvaluationError(f"another evaluation is writing to {directory}") from None
        except EvaluationError:
            self._file.close()
            raise

    def __contains__(self, question: Question) -> bool:
        """Whether there is nothing left to ask: it is answered, or there is no answer."""
        return question.key in self._answers or question.key in self._uncovered

    def answered(self, questions: Iterable[Question]) -> Iterator[tuple[Question, Answer]]:
        """Yield those that are answered, with their answers."""
        for question in questions:
            if question.key in self._answers:
                yield question, self._answers[question.key]

    def get(self, question: Question) -> Answer | None:
        """Return the latest answer, if there is one."""
        return self._answers.get(question.key)

    def begin(self, session: Session) -> None:
        """Say who answers from here on.

        Raises:
            EvaluationError: the answers so far are another version's, or a model has changed.
        """
        for before in self.sessions:
            shared = before.models.keys() & session.models.keys()
            changed = any(before.models[name] != session.models[name] for name in shared)
            if changed or before.version != session.version:
                raise EvaluationError(
                    f"the answers in {self._path.parent} come from {_described(before)}, and this "
                    f"service is {_described(session)}; choose another folder"
                )
        self._write({"session": session.model_dump(mode="json")})
        self.sessions.append(session)

    def append(self, question: Question, content: Mapping[str, Any], latency_ms: float) -> None:
        """Keep an answer: its line is complete on disk when this returns."""
        kept = question.body | {
            "answer": _kept(content, question),
            "latency_ms": round(latency_ms, 3),
        }
        self._write(kept)
        self._answers[question.key] = Answer(kept["answer"], kept["latency_ms"])

    def leave_out(self, question: Question) -> None:
        """Keep that there is no answer: no model covers a plant, or nothing follows from a log."""
        self._write(question.body | {"uncovered": True})
        self._uncovered.add(question.key)

    def pack(self) -> None:
        """Compress the log, once there is nothing left to ask."""
        _replace(self._path, self._packed, unpack=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def _write(self, line: Mapping[str, Any]) -> None:
        text = json.dumps(line).encode() + b"\n"
        if self._file.write(text) < len(text):
            raise OSError(f"{self._path} took only a part of an answer: is the disk full?")

    def _read(self) -> None:
        self._file.seek(0)
        complete = 0
        for number, line in enumerate(self._file.readlines(), 1):
            if not line.endswith(b"\n"):
                self._file.truncate(complete)
                break
            complete += len(line)
            try:
                self._take(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                raise EvaluationError(f"{self._path}, line {number}, is damaged: {error}") from None

    def _take(self, line: Any) -> None:
        if not isinstance(line, dict):
            raise TypeError("not an object")
        if "session" in line:
            self.sessions.append(Session.model_validate(line["session"]))
            return
        if line.pop("uncovered", False):
            self._uncovered.add(key_of(line))
            return
        answer = Answer(line.pop("answer"), line.pop("latency_ms"))
        self._answers[key_of(line)] = answer


def _kept(content: Mapping[str, Any], question: Question) -> dict[str, Any]:
    """Drop what was not wanted of an answer."""
    kept = _without_trajectories(content, question.trajectories)
    if question.kept_steps:
        states = (run["states"] for run in content["runs"])
        kept["runs"] = [
            _without_trajectories(run, False) | {"states": [of_run[k] for k in question.kept_steps]}
            for run, of_run in zip(content["runs"], states, strict=True)
        ]
    return kept


def _without_trajectories(content: Mapping[str, Any], wanted: bool) -> dict[str, Any]:
    """Drop what was not wanted; segments repeat the composed trajectory, and lose theirs always."""
    kept = {name: value for name, value in content.items() if wanted or name not in TRAJECTORIES}
    if "segments" in kept:
        kept["segments"] = [_without_trajectories(part, False) for part in kept["segments"]]
    return kept


def _described(session: Session) -> str:
    hashes = sorted(session.models.items())
    models = ", ".join(f"{name} {sha[:12]}" for name, sha in hashes) or "no models"
    return f"version {session.version} with {models}"


def _replace(source: Path, destination: Path, *, unpack: bool) -> None:
    """Copy `source` packed or unpacked to `destination`, all or nothing, then remove it."""
    unfinished = destination.with_suffix(".unfinished")
    with (
        lzma.LZMAFile(source) if unpack else source.open("rb") as reader,
        unfinished.open("wb") if unpack else lzma.LZMAFile(unfinished, "wb") as writer,
    ):
        shutil.copyfileobj(reader, writer)
    unfinished.replace(destination)
    source.unlink()
