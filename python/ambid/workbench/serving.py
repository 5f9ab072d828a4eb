"""The server on this machine alone, and the browser that opens its page."""

import secrets
import socket
import webbrowser
from collections.abc import Callable
from threading import Thread

from ambid.errors import InputError
from ambid.workbench.windows import Windows


def require_server() -> None:
    """Refuse to begin where a package of the extra is missing.

    Raises
    ------
    InputError
        If it is.
    """
    try:
        import plotly  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise InputError(f"the workbench needs the package {error.name}: pip install 'ambid[workbench]'") from None


def serve(windows: Windows, port: int, *, say: Callable[[str], None], opens_browser: bool) -> None:
    """Serve the page on 127.0.0.1 until a signal ends it.

    Parameters
    ----------
    windows : Windows
        What the page works on.
    port : int
        0 takes a free one.
    say : callable
        Told the address, which holds the token.
    opens_browser : bool

    Raises
    ------
    InputError
        If the port is taken or not allowed.
    """
    import uvicorn

    from ambid.workbench.server import application

    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
            listening.listen()  # from here on a browser may ask; it waits until the server answers
        except (OSError, OverflowError) as error:
            raise InputError(f"--port {port}: {error}; give another one, or 0 for any that is free") from None
        port, token = listening.getsockname()[1], secrets.token_urlsafe(24)
        address = f"http://127.0.0.1:{port}/{token}/"
        say(address)
        if opens_browser:
            Thread(target=webbrowser.open, args=(address,), daemon=True).start()  # some return when they are closed
        config = uvicorn.Config(
            application(windows, token, port),
            log_level="error",
            access_log=False,  # it would hold the token
            server_header=False,
            timeout_graceful_shutdown=1,  # so long may calls that are being answered take when the server ends
        )
        uvicorn.Server(config).run(sockets=[listening])
