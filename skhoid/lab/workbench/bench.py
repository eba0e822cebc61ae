"""``Workbench``: what is open, and what is done with it, whichever page asks."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ... import report
from ...exceptions import IrregularSamplingError, ShortRunError
from ...io import shown
from ..explore import Exploration
from ..explore.models import Position
from ..explore.view import Found
from ..guessing import UnclearColumnsError
from ..opening import make_estimator
from .columns import (
    KINDS,
    Choices,
    Columns,
    Recorded,
    UnfitChoiceError,
    look,
    noted,
    read,
    search_settings,
)
from .jobs import SearchJob
from .preparation import Prepared, prepare, tell_steps
from .session import SEARCH, NotSaved, SessionFolder, make_digest

HISTORY = frozenset(
    ("add", "remove", "release", "refit", "free", "undo", "redo", "use", "recall", "structure")
)
MODELS = frozenset(("keep", "drop"))
READING = frozenset(("trace", "preview", "drag", "state", "script", "model", "linear", "people"))
UNFINISHED = (
    "The search was not finished when the workbench ended: nothing of it was kept. Start it again."
)


ONTO_A_GRID = (
    'The clock is irregular: tick "Bring an irregular clock onto a grid" below, and check again.'
)
LEAVING_FEW = ("decimate", "measurement_time", "run_in", "until")  # the likeliest first
QUIET = 15.0  # s, after which a comment keeps the connection alive


def put_in_words(error: BaseException) -> str:
    """An error as a sentence for the user."""
    if isinstance(error, MemoryError):
        return "The memory does not suffice for this."
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'The file'}: {error.strerror}."
    text = error.args[0] if isinstance(error, KeyError) and error.args else error
    return " ".join(str(text).split()) or type(error).__name__


def tell_preparation(prepared: Prepared | None, choices: Choices) -> dict[str, str]:
    """The pipeline in words, and what it costs; nothing of it before there is any."""
    if prepared is None:
        return {"steps": "", "note": ""}
    return {"steps": tell_steps(prepared, choices), "note": prepared.note}


class News:
    """What has changed, told to every page that listens."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: dict[asyncio.Queue[Any], asyncio.AbstractEventLoop] = {}
        self.counts = {"state": 0, "opening": 0}
        self._closed = False

    def tell(self, *changed: str, **more: Any) -> None:
        """Tell that "state" or "opening" has changed, and more."""
        with self._lock:
            for name in changed:
                self.counts[name] += 1
            message = {**self.counts, **more}
            listeners = list(self._listeners.items())
        for queue, loop in listeners:
            _put(queue, loop, message)

    def close(self) -> None:
        """End all connections: no page is to hold up the end of the server."""
        with self._lock:
            self._closed = True
            listeners = list(self._listeners.items())
        for queue, loop in listeners:
            _put(queue, loop, None)

    async def stream(self) -> AsyncIterator[str]:
        """Messages for one page, beginning with how things are."""
        queue: asyncio.Queue[Any] = asyncio.Queue()
        with self._lock:
            if self._closed:
                return
            self._listeners[queue] = asyncio.get_running_loop()
            message: Any = dict(self.counts)
        try:
            while message is not None:
                yield f"data: {json.dumps(message)}\n\n"
                message = await self._next(queue)
                while message == "":
                    yield ": still here\n\n"
                    message = await self._next(queue)
        finally:
            with self._lock:
                self._listeners.pop(queue, None)

    async def _next(self, queue: asyncio.Queue[Any]) -> Any:
        try:
            return await asyncio.wait_for(queue.get(), QUIET)
        except TimeoutError:
            return ""


def _put(queue: asyncio.Queue[Any], loop: asyncio.AbstractEventLoop, message: Any) -> None:
    try:
        loop.call_soon_threadsafe(queue.put_nowait, message)
    except RuntimeError:  # its loop has ended, and the page with it
        return


class Workbench:
    """Files, their columns, and the exploration of them; one for all pages that are open."""

    def __init__(self, folder: SessionFolder, paths: list[Path], choices: Choices):
        self.folder, self.given = folder, choices
        self.choices = choices
        self.news = News()
        self.files: dict[str, dict[str, Any]] = {}
        self.chosen: list[str] = []
        self.phase, self.doing, self.message, self.field = "empty", "", "", ""
        self.notes: list[str] = []
        self.unsaved = ""
        self._keeps_more = False  # whether the folder holds what could not be opened again
        self.columns: Columns | None = None
        self.recorded: Recorded | None = None
        self.prepared: Prepared | None = None
        self.problems: list[dict[str, Any]] = []
        self.exploration: Exploration | None = None
        self._found: Found | None = None  # what the folder holds of a search
        self._job: SearchJob | None = None
        self._lock = threading.RLock()  # of this object; never held while something is computed
        self._saving = threading.Lock()
        self._round = 0  # what was begun for an older choice of files is dropped
        self._opener = ThreadPoolExecutor(1, "skhoid-opening")
        self._judge = ThreadPoolExecutor(2, "skhoid-judging")
        self._judged_again = False
        self.chosen = [self._register(path, "command line") for path in paths]

    def _register(self, path: Path, origin: str) -> str:
        name = f"{len(self.files)}"
        self.files[name] = {"path": path, "name": shown(path.name), "from": origin}
        return name

    # What a session keeps, and how it comes back.

    def begin(self, kept: Mapping[str, Any] | None) -> None:
        """Start reading: the files of the command line, or what a session kept."""
        if kept is not None:
            self.given = Choices(**kept["asked"])
            self.choices = Choices(**kept["choices"])
            self.files, self.chosen = {}, []
            for file in kept.get("files", []):
                path = self.folder.uploads / file["upload"] if "upload" in file else file["path"]
                name = self._register(Path(path), file.get("from", "command line"))
                self.files[name]["digest"] = {k: file.get(k) for k in ("size", "sha256")}
                self.chosen.append(name)
            if kept.get("searching"):
                self.notes.append(UNFINISHED)
        if self.chosen:
            memory = None if kept is None else kept.get("exploration")
            if memory is not None and memory.get("searched"):
                memory["search"] = self.folder.load(SEARCH)
            self._open(memory, reopened=kept is not None)

    def _kept(self) -> dict[str, Any]:
        files = []
        for name in self.chosen:
            file = self.files[name]
            path: Path = file["path"]
            where = "upload" if file["from"] == "uploaded" else "path"
            files.append(
                {
                    where: path.name if where == "upload" else str(path),
                    "from": file["from"],
                    **file.get("digest", {}),
                }
            )
        exploration = self.exploration
        memory = None
        if exploration is not None:
            searched = exploration.found.result is not None
            memory = {**exploration.memory(), "searched": searched}
        return {
            "asked": self.given.as_dict(),
            "choices": self.choices.as_dict(),
            "files": files,
            "exploration": memory,
            "searching": self._job is not None,
        }

    def save(self) -> None:
        """Keep the session; where that fails it is said, and the work goes on."""
        with self._saving:
            before = self.unsaved
            try:
                self._save_search()
                self.folder.save(self._kept())
                self.unsaved, self._keeps_more = "", False
            except OSError as error:
                self.unsaved = (
                    f"The session was not saved: {put_in_words(error)} What was saved before is "
                    "still there. Make room, or let the folder be written into; it is saved "
                    "again with the next step."
                )
        if before != self.unsaved:
            self.news.tell("opening")

    def _save_search(self) -> None:
        """Keep what was found in a file of its own: it is large, and stays the same."""
        found = None if self.exploration is None else self.exploration.found
        if found is not None and found is not self._found and found.result is not None:
            self.folder.save(found.as_dict(), SEARCH)
            self._found = found

    # Files and columns.

    def opening(self) -> dict[str, Any]:
        """What the page shows before the component."""
        with self._lock:
            columns, recorded = self.columns, self.recorded
            count = self.news.counts["opening"]  # of replies that overtake each other the newest
            return {
                "count": count,
                "phase": self.phase,
                "doing": self.doing,
                "message": self.message,
                "field": self.field,
                "notes": [*self.notes, *filter(None, [self.unsaved])],
                "session": str(self.folder.path),
                "kept": self._keeps_more,
                "kinds": [{"kind": kind, "words": words} for kind, words in KINDS.items()],
                "files": [self._file(name) for name in self.chosen],
                "columns": [] if columns is None else columns.table,
                "guess": "" if columns is None else str(columns.guess),
                "problems": self.problems,
                "recorded": "" if recorded is None else recorded.words,
                "findings": [] if recorded is None else recorded.findings,
                "checked": recorded is not None,
                "model": self.choices.as_dict(),
                **tell_preparation(self.prepared, self.choices),
            }

    def _file(self, name: str) -> dict[str, Any]:
        file = self.files[name]
        return {"id": name, "name": file["name"], "from": file["from"]}

    def uploaded(self, path: Path) -> dict[str, Any]:
        """A file that has arrived in the session's folder."""
        with self._lock:
            return self._file(self._register(path, "uploaded"))

    def open(self, names: Any) -> None:
        """Open files that are known here by their ids; what was done with others is given up."""
        known = isinstance(names, list) and all(
            isinstance(name, str) and name in self.files for name in names
        )
        if not known or not names:
            raise ValueError("Choose at least one file.")
        self.stop()
        with self._lock:
            self.chosen = list(dict.fromkeys(names))
            self.choices = self.given
            self.notes, self.columns = [], None
            self._discard(read_again=True)
        self._open(None)

    def correct(self, asked: Mapping[str, Any]) -> None:
        """Take what the page says of columns and model, and check the data again."""
        with self._lock:
            self._take(asked)
            self._discard(read_again=True)
        self._open(None)

    def fit(self, asked: Mapping[str, Any]) -> None:
        """Fit the model to what is chosen, and then search if that is asked for, too."""
        with self._lock:
            before = self.choices.of_reading
            self._take(asked)
            self._discard(read_again=before != self.choices.of_reading)
        self._open(None, fit=True, search=bool(asked.get("search")))

    def try_preparation(self, asked: Mapping[str, Any]) -> dict[str, str]:
        """What would be done to the recordings with these choices, which are not taken yet."""
        with self._lock:
            columns, recorded = self.columns, self.recorded
            choices = self.choices
        try:
            choices = choices.corrected(asked, [] if columns is None else columns.names)
            prepared = None if recorded is None else prepare(recorded, choices)
        except UnfitChoiceError as error:
            return {**tell_preparation(None, choices), "message": str(error), "field": error.field}
        return tell_preparation(prepared, choices)

    def back(self) -> None:
        """Back to the columns: what was explored is given up, as the page has asked before."""
        self.stop()
        with self._lock:
            self._discard(read_again=False)
            self.phase = "columns"
        self.save()
        self.news.tell("opening", "state")

    def _take(self, asked: Mapping[str, Any]) -> None:
        if self.columns is None:
            raise ValueError("Choose files first.")
        if self.exploration is not None:
            raise ValueError("The model is fitted already, in another tab: go back to the columns.")
        asked = dict(asked)
        for of_column in ("kind", "unit"):  # what the page has not changed is left as it was
            shown_now = {column["name"]: column[of_column] for column in self.columns.table}
            if asked.get(f"{of_column}s") == shown_now:
                del asked[f"{of_column}s"]
        self.choices = self.choices.corrected(asked, self.columns.names)

    def _discard(self, *, read_again: bool) -> None:
        if self.exploration is not None and self.exploration.people is not None:
            self.exploration.people.stopped = True
        self.exploration = None
        self.message = self.field = ""
        self.prepared = None
        self._round += 1
        if read_again:
            self._forget_notes()
            self.recorded, self.problems = None, []

    def _open(
        self, memory: Any, *, reopened: bool = False, fit: bool = False, search: bool = False
    ) -> None:
        with self._lock:
            this = self._round
            self.doing = f"Reading {', '.join(self.files[n]['name'] for n in self.chosen)} ..."
            if self.columns is None:
                self.phase = "reading"
        self.news.tell("opening")
        self._opener.submit(self._opened, this, memory, reopened, fit or memory is not None, search)

    def _opened(self, this: int, memory: Any, reopened: bool, fit: bool, search: bool) -> None:
        """Look, read, check and fit, each told as soon as it is done; in a thread of its own."""
        try:
            paths = [self.files[name]["path"] for name in self.chosen]
            why = self._changed_files() if reopened else ""
            if self.recorded is None:
                self._look(this, paths)
                self._read(this, paths)
            self._prepare(this)
            if why:
                raise ValueError(why)
            if fit:
                self._fit(this, memory)
        except UnclearColumnsError as error:
            self._unclear(this, error)
        except Exception as error:
            self._keeps_more |= memory is not None
            self._failed(this, error)
        else:
            self._finished(this, fit, search)

    def _finished(self, this: int, fit: bool, search: bool) -> None:
        with contextlib.suppress(_Overtaken):
            self.save()  # before it is told: who is told may end the workbench at once
            self._now(this, doing="")
            if fit:
                self.news.tell("state")
                self._judge_soon()
                if search:
                    self.search()

    def _now(self, this: int, **values: Any) -> None:
        with self._lock:
            if this != self._round:
                raise _Overtaken
            for name, value in values.items():
                setattr(self, name, value)
        self.news.tell("opening")

    def _changed_files(self) -> str:
        """What has become of files since the session was kept."""
        found = []
        for name in self.chosen:
            path, digest = self.files[name]["path"], self.files[name].get("digest", {})
            if not path.is_file():
                raise ValueError(
                    f"{shown(path)} is not there any more, and this session is about it: put it "
                    "back and start the workbench again, or choose files anew."
                )
            if digest.get("sha256") and make_digest(path) != digest:
                found.append(
                    f"{shown(path)} has changed since this session was kept, so its numbers would "
                    "not be the same. Put the old file back and start the workbench again, or fit "
                    "anew."
                )
        return " ".join(found)

    def _look(self, this: int, paths: list[Path]) -> None:
        columns = look(paths, self.choices)
        self._now(this, columns=columns, problems=columns.problems, phase="columns")

    def _read(self, this: int, paths: list[Path]) -> None:
        assert self.columns is not None
        recorded = read(paths, self.columns, self.choices)
        for name in self.chosen:
            self.files[name]["digest"] = make_digest(self.files[name]["path"])
        self._now(this, recorded=recorded, problems=[])

    def _prepare(self, this: int) -> None:
        assert self.recorded is not None
        self._now(this, prepared=prepare(self.recorded, self.choices))

    def _fit(self, this: int, memory: Any) -> None:
        recorded, prepared = self.recorded, self.prepared
        assert recorded is not None
        assert prepared is not None
        self._now(this, phase="fitting", doing="Fitting the model without effects ...")
        about = {"inputs": recorded.inputs, "roles": recorded.roles or None}
        try:
            model = make_estimator(self.choices, prepared.X, prepared.y, **about)
            exploration = Exploration(
                model,
                prepared.X,
                prepared.y,
                options=search_settings(self.choices),
                title=", ".join(self.files[name]["name"] for name in self.chosen),
                source=prepared.source,
                memory=memory,
                preparation=prepared.words,
                shift=prepared.shift,
            )
            exploration.state()
        except ShortRunError as error:
            field = next((name for name in LEAVING_FEW if self._leaves_fewer(name)), "")
            if not field:
                raise
            raise UnfitChoiceError(f"Too few rows are left. {error}", field) from error
        self._now(this, exploration=exploration, phase="bench")

    def _leaves_fewer(self, name: str) -> bool:
        return getattr(self.choices, name) != getattr(Choices(), name)

    def _unclear(self, this: int, error: UnclearColumnsError) -> None:
        with contextlib.suppress(_Overtaken):
            columns = self.columns
            table = [] if columns is None else columns.table
            problems = [noted(problem, table) for problem in error.problems]
            self._now(this, phase="columns", doing="", problems=problems)

    def _failed(self, this: int, error: Exception) -> None:
        with contextlib.suppress(_Overtaken):
            phase = "empty" if self.columns is None else "columns"
            message = put_in_words(error)
            if isinstance(error, IrregularSamplingError):
                message = f"{ONTO_A_GRID} {message}"
            field = getattr(error, "field", "")
            self._now(this, phase=phase, doing="", message=message, field=field)

    # The component.

    def _open_exploration(self) -> Exploration:
        exploration = self.exploration
        if exploration is None:
            raise ValueError("No model is fitted here: it was given up, maybe in another tab.")
        return exploration

    def view(self) -> dict[str, Any]:
        """What the component is told once."""
        return self._open_exploration().view()

    def state(self) -> dict[str, Any]:
        """What the component is told after a change."""
        return self._open_exploration().state()

    def act(self, name: str, args: Mapping[str, Any], by: str = "") -> dict[str, Any]:
        """Do what the component asks; ``by`` is the page that asks."""
        others: dict[str, Callable[[], dict[str, Any]]] = {
            "search": self.search,
            "stop": self.stopped,
            "report": self.report,
            "fit_people": self.fit_people,
            "stop_people": self.stop_people,
        }
        if name in others:
            return others[name]()
        exploration = self._open_exploration()
        if name not in HISTORY | MODELS | READING:
            raise ValueError(f"There is no action {name!r:.80}.")
        if name in HISTORY:
            self._forget_notes()
        reply = exploration.act(name, args)
        if name in HISTORY | MODELS:
            self.save()
            self.news.tell("state", by=by, revision=exploration.revision)
            self._judge_soon()
        return reply

    def _judge_soon(self) -> None:
        """Find the noise ceiling of the present model, unless a thread is about to."""
        with self._lock:
            if self._judged_again:
                return
            self._judged_again = True
        with contextlib.suppress(RuntimeError):  # the workbench ends
            self._judge.submit(self._judging)

    def _judging(self) -> None:
        with self._lock:
            self._judged_again = False
            exploration = self.exploration
        if exploration is None:
            return
        try:
            exploration.judge()
        except Exception as error:
            self.note(f"The noise ceiling could not be found: {put_in_words(error)}")
        if exploration is self.exploration:
            self.news.tell("state", revision=exploration.revision)

    def _forget_notes(self) -> None:
        """Take away what was said of an earlier model."""
        with self._lock:
            before, self.notes = self.notes, [note for note in self.notes if note == UNFINISHED]
        if before != self.notes:
            self.news.tell("opening")

    def note(self, text: str) -> None:
        """Say something beside what was asked for."""
        with self._lock:
            self.notes = [*(note for note in self.notes if note != text), text][-5:]
        self.news.tell("opening")

    def search(self) -> dict[str, Any]:
        """Start a search from the present model, unless one is running."""
        exploration = self._open_exploration()
        with self._lock:
            if self._job is None:
                search, X, y = exploration.search_for()
                search.set_params(n_jobs=1)
                began = exploration.here
                self.notes = [note for note in self.notes if note != UNFINISHED]

                def ended(job: SearchJob, found: Any, why: str) -> None:
                    self._search_ended(job, found, began, why)

                exploration.searching({"share": 0.0, "words": "The search starts."})
                self._job = SearchJob(search, X, y, self._progress, ended)
        self.save()
        self.news.tell("state")
        return {"state": exploration.state()}

    def _progress(self, share: float, words: str) -> None:
        exploration = self.exploration
        if exploration is not None and self._job is not None:
            told = {"share": share, "words": words}
            exploration.searching(told)
            self.news.tell(search=told)

    def _search_ended(self, job: SearchJob, found: Any, began: Position, why: str) -> None:
        with self._lock:
            if job is not self._job:
                return
            self._job, exploration = None, self.exploration
            if exploration is None:
                return
            exploration.searching(None)
            if found is not None:
                exploration.take_search(found, began)
        if why:
            self.note(why)
        self.save()
        self.news.tell("state")
        self._judge_soon()

    def stop(self) -> None:
        """End a running search at once."""
        with self._lock:
            job, self._job = self._job, None
            if job is not None and self.exploration is not None:
                self.exploration.searching(None)
        if job is not None:
            job.stop()

    def stopped(self) -> dict[str, Any]:
        """End a running search, for the component."""
        self.stop()
        self.save()
        self.news.tell("state")
        return {"state": self.state()}

    def fit_people(self) -> dict[str, Any]:
        """Fit the present effects to each person alone, in a thread."""
        exploration = self._open_exploration()
        fits = exploration.begin_people()

        def fitting() -> None:
            for _ in fits.fit():
                self.news.tell("state")
            self.news.tell("state")

        threading.Thread(target=fitting, daemon=True, name="skhoid-people").start()
        return {"state": exploration.state()}

    def stop_people(self) -> dict[str, Any]:
        """Fit no further person; those fitted stay."""
        people = self._open_exploration().people
        if people is not None:
            people.stopped = True
        return {"state": self.state()}

    def report(self) -> dict[str, Any]:
        """Write the report on the present model into the session's folder."""
        exploration = self._open_exploration()
        page = report(
            exploration,
            source=", ".join(self.files[name]["name"] for name in self.chosen),
            made_with={
                "command": f"skhoid workbench --session {self.folder.path}",
                "Fitted": str(exploration.preparation_of(exploration.here)),
            },
        )
        try:
            path = page.save(self.folder.free("report.html"))
        except OSError as error:
            raise NotSaved(
                f"The report was not saved: {put_in_words(error)} Nothing else is lost: make room, "
                "or let the folder be written into, and save it again."
            ) from error
        text = f"The report is saved: {path}"
        return {"href": f"/api/report/{path.name}", "name": path.name, "text": text}

    def script(self) -> str:
        """The present model as Python."""
        return self._open_exploration().script()

    def close(self) -> None:
        """Keep the session, with whether a search was running, and end searches and threads."""
        self.news.close()
        if self.exploration is not None:
            self.save()
        self.stop()
        for pool in (self._opener, self._judge):
            pool.shutdown(wait=False, cancel_futures=True)
        self.folder.give_back()


class _Overtaken(Exception):
    """Something else was chosen meanwhile."""
