"""The page's calls, as JSON: each is one method of a session, or a view of it; and who may make them.

That is this machine's browser on this page, and nobody else. Another page in the same browser can send requests to
127.0.0.1; it knows neither the token, nor can it forge `Host` and `Origin`, which the browser writes. A name that an
attacker points at 127.0.0.1 is not among the hosts.
"""

import json
import secrets
from collections.abc import Awaitable, Callable
from importlib.resources import files
from math import isfinite
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ambid.errors import AmbidError, InputError, StaleWindow
from ambid.workbench import frequency_views, views
from ambid.workbench.exporting import as_model_file, as_python
from ambid.workbench.session import Session
from ambid.workbench.windows import Window, Windows

PAGE = Path(__file__).parent / "page"
ASSETS = tuple(sorted(path.name for path in PAGE.iterdir() if path.suffix in (".js", ".css")))
LARGEST_BODY = 10_000
"""Bytes of a call; none is longer than a few names and numbers."""
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "cache-control": "no-store",
}
"""Of every answer. Inline styles are what the charts' library writes; nothing is loaded from elsewhere."""

Json = dict[str, Any]
Answer = Callable[[Window, Json], Json | Response]
Look = Callable[[Session, Json], Json]
Do = Callable[[Window, Json], None]


def application(windows: Windows, token: str, port: int) -> ASGIApp:
    """The server's application.

    Parameters
    ----------
    windows : Windows
        What the page works on.
    token : str
        First part of every path; without it nothing is answered.
    port : int
        That the server listens at.
    """

    def of_window(answer: Answer) -> Callable[[Request], Awaitable[Response]]:
        async def endpoint(request: Request) -> Response:
            given = dict(request.query_params) if request.method == "GET" else await _body(request)
            window = windows.find(request.path_params["window"])
            found = await run_in_threadpool(answer, window, given)
            return found if isinstance(found, Response) else JSONResponse(found)

        return endpoint

    async def opened(request: Request) -> Response:
        await _body(request)
        return JSONResponse({"window": windows.open()})

    def of_step(look: Look) -> Answer:
        def answer(window: Window, given: Json) -> Json | Response:
            session = window.at(_whole(given, "revision"))
            # answer to a question about a step that is no longer the present one: there is nothing to show of it
            return Response(status_code=204) if session is None else look(session, given)

        return answer

    def viewed(do: Do) -> Answer:
        def answer(window: Window, given: Json) -> Json:
            do(window, given)
            return window.view()

        return answer

    def route(path: str, answer: Answer, method: str) -> Route:
        return Route(f"/{token}/windows/{{window}}/{path}", of_window(answer), methods=[method])

    routes = [
        Route(f"/{token}/", _file(PAGE / "index.html")),
        *(Route(f"/{token}/{name}", _file(PAGE / name)) for name in ASSETS),
        Route(f"/{token}/plotly.min.js", _file(_plotly())),
        Route(f"/{token}/windows", opened, methods=["POST"]),
        *(route(path, of_step(look), "GET") for path, look in SHOWN.items()),
        *(route(path, answer, "GET") for path, answer in ASKED.items()),
        *(route(path, viewed(do), "POST") for path, do in DONE.items()),
    ]
    return Guard(Starlette(routes=routes, exception_handlers={AmbidError: _refused}), token, port)


def _lines(session: Session, given: Json) -> Json:
    record, pixels = _whole(given, "record"), _whole(given, "pixels")
    return frequency_views.lines(session, record, str(_given(given, "channel")), pixels)


def _signals(session: Session, given: Json) -> Json:
    span = (_number(given, "from"), _number(given, "to")) if "from" in given else None
    record, pixels = _whole(given, "record"), _whole(given, "pixels")
    return views.signals(session, record, str(_given(given, "channel")), span, pixels, given.get("input"))


def _responses(session: Session, given: Json) -> Json:
    record, pixels = _whole(given, "record"), _whole(given, "pixels")
    channel, inlet = str(_given(given, "channel")), given.get("input")
    return frequency_views.responses(session, record, channel, inlet, pixels)


def _predicted(session: Session, given: Json) -> Json:
    """What would be left with a candidate; nothing is changed."""
    channel, effect = str(_given(given, "channel")), str(_given(given, "effect"))
    return frequency_views.prediction(session, _whole(given, "record"), channel, effect)


def _preview(session: Session, given: Json) -> Json:
    """The misfits that a value would have; nothing is changed."""
    return views.misfits(session.move(str(_given(given, "name")), _number(given, "value")))


def _report(window: Window, _: Json) -> Response:
    if not window.report:
        raise InputError("there is no report yet; write it first")
    return _download("report.html", "text/html", window.report)


def _move(window: Window, given: Json) -> None:
    name, value = str(_given(given, "name")), _number(given, "value")
    window.go(_whole(given, "revision"), lambda session: session.move(name, value))


def _add(window: Window, given: Json) -> None:
    name = str(_given(given, "name"))
    window.start(_whole(given, "revision"), f"add {name}", lambda session, progress: session.add(name, progress))


def _remove(window: Window, given: Json) -> None:
    name = str(_given(given, "name"))
    window.start(_whole(given, "revision"), f"remove {name}", lambda session, progress: session.remove(name, progress))


SHOWN: dict[str, Look] = {
    "where": lambda session, _: views.where(session),
    "candidates": lambda session, _: views.candidates(session),
    "lines": _lines,
    "signals": _signals,
    "responses": _responses,
    "matrix": lambda session, _: {"matrices": frequency_views.matrices(session)},
    "predicted": _predicted,
    "preview": _preview,
}
"""Views of the step that the page shows, which it names: one that has been left behind is not answered for another."""
ASKED: dict[str, Answer] = {
    "view": lambda window, _: window.view(),
    "workbench.py": lambda window, _: _download("workbench.py", "text/x-python", as_python(window.session).encode()),
    "model.json": lambda window, _: _download("model.json", "application/json", as_model_file(window.session)),
    "report.html": _report,
}
"""Further calls that change nothing, about the step as it is now."""
DONE: dict[str, Do] = {
    "move": _move,
    "undo": lambda window, given: window.go(_whole(given, "revision"), Session.undo),
    "fit": lambda window, given: window.start(_whole(given, "revision"), "fit", Session.fit),
    "rank": lambda window, given: window.start(_whole(given, "revision"), "rank", Session.ranked),
    "add": _add,
    "remove": _remove,
    "report": lambda window, given: window.start_report(_whole(given, "revision")),
    "cancel": lambda window, _: window.cancel(),
}
"""Calls that make a step, or begin the job that makes it; the answer is how the window stands then."""


async def _body(request: Request) -> Json:
    """The object that a call carries; only JSON, which a foreign form cannot send."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise InputError("a call carries application/json")
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > LARGEST_BODY:
            raise InputError(f"a call has at most {LARGEST_BODY} bytes")
    try:
        found = json.loads(content)
    except ValueError:
        raise InputError("a call carries a JSON object; this is none") from None
    if not isinstance(found, dict):
        raise InputError("a call carries a JSON object; this is none")
    return found


def _given(given: Json, name: str) -> Any:
    if name not in given:
        raise InputError(f"{name} is missing")
    return given[name]


def _number(given: Json, name: str) -> float:
    text = _given(given, name)
    try:
        value = float(text)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {text!r}: expected a number") from None
    if not isfinite(value):
        raise InputError(f"{name} = {value}: expected a finite number")
    return value


def _whole(given: Json, name: str) -> int:
    value = _number(given, name)
    if value != int(value):
        raise InputError(f"{name} = {value:g}: expected a whole number")
    return int(value)


async def _refused(_: Request, error: Exception) -> Response:
    """An error that a person can act on, as its sentence."""
    code = 409 if isinstance(error, StaleWindow) else 400 if isinstance(error, InputError) else 422
    return JSONResponse({"error": str(error)}, code)


def _file(path: Path) -> Callable[[Request], Awaitable[Response]]:
    async def endpoint(_: Request) -> Response:
        return FileResponse(path)

    return endpoint


def _download(name: str, media_type: str, content: bytes) -> Response:
    return Response(content, media_type=media_type, headers={"content-disposition": f'attachment; filename="{name}"'})


def _plotly() -> Path:
    """The charts' library, as its package brings it."""
    return Path(str(files("plotly"))) / "package_data" / "plotly.min.js"


class Guard:
    """Refuses requests under another host name, from another origin, or without the token in the path.

    Parameters
    ----------
    app : callable
        Sees only what may pass.
    token : str
        First part of every path.
    port : int
        That the server listens at.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self.app, self.token = app, token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer as ASGI has it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # there is no other way to speak to this server

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message["headers"] = [*message["headers"], *own]
            await send(message)

        why = self._why_not(Headers(scope=scope), scope["path"])
        await (PlainTextResponse(why, 403) if why else self.app)(scope, receive, send_guarded)

    def _why_not(self, headers: Headers, path: str) -> str:
        """Why a request is refused; empty where it may pass."""
        if headers.get("host", "") not in self.hosts:
            return "refused: this host name is not the workbench's"
        origin = headers.get("origin")
        if origin is not None and origin.removeprefix("http://") not in self.hosts:
            return "refused: the request comes from another origin"
        if headers.get("sec-fetch-site", "") not in ("", "same-origin", "none"):  # by this page, or the address bar
            return "refused: the request comes from another site"
        if not secrets.compare_digest(path.removeprefix("/").partition("/")[0].encode(), self.token.encode()):
            return "refused: the token is wrong; open the address that the command printed"
        return ""
