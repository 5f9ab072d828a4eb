"""Who may speak to the server: this machine's browser on this page, and nobody else.

Another page in the same browser can send requests to 127.0.0.1; it knows neither the token, nor can it forge `Host` and
`Origin`, which the browser writes. A name that an attacker points at 127.0.0.1 is not among the hosts.
"""

import secrets

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
OWN = ("", "same-origin", "none")
"""Values of `Sec-Fetch-Site` of requests by this page, or by the address bar."""


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
        if headers.get("sec-fetch-site", "") not in OWN:
            return "refused: the request comes from another site"
        if not secrets.compare_digest(path.removeprefix("/").partition("/")[0].encode(), self.token.encode()):
            return "refused: the token is wrong; open the address that the command printed"
        return ""
