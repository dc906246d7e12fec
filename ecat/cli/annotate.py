"""``ecat annotate``: the annotation page, served to the browser on this machine."""

from __future__ import annotations

import getpass
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.web import Server


@verb(
    "annotate",
    examples=("ecat annotate my_session", "ecat annotate my_project --author ann --no-browser --port 8000"),
)
@click.argument("path", type=click.Path(path_type=Path), help="A session, project or workspace.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    metavar="N",
    help="Listen there; 8765 or any that is free by default.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    metavar="ADDRESS",
    help="Listen there instead of on this machine alone: others on the network can then ask, unencrypted.",
)
@click.option("--no-browser", is_flag=True, help="Do not open a browser, only print the address.")
@click.option("--author", metavar="NAME", help="Who annotates; the name of your account by default.")
@click.option("--layer", default="main", metavar="NAME", help="The layer to begin with; main by default.")
def command(
    out: Output, path: Path, port: int | None, host: str, no_browser: bool, author: str | None, layer: str
) -> None:
    """Annotate sessions in the browser.

    Serves a page on this machine and prints its address, which lets one browser in; when it was used, the next one is
    printed, for somebody else.  Every edit is on the disk when it is acknowledged; Ctrl-C saves the layers and
    ends.  From another machine: ssh -L 8765:127.0.0.1:8765 THIS_MACHINE, then open the address there.
    """
    from ecat.cli.describe import require_folder
    from ecat.web import Server

    require_folder(path)
    server = Server(path, host=host, port=port, author=_account() if author is None else author, layer=layer)
    _warn(server)
    url = server.url()
    out.result(
        {"url": url, "address": server.address, "token": server.site.access.invite()},
        f"{server.site.library.name} can be annotated at {url}\nthe address lets one browser in; Ctrl-C saves and ends",
    )
    server.site.access.on_entry = lambda: _say(out, f"for somebody else: {server.url()}")
    sys.stdout.flush()
    if not (no_browser or out.as_json):
        _open_browser(url)
    server.run()
    _say(out, "saved")


def _say(out: Output, text: str) -> None:
    out.say(text)
    sys.stdout.flush()


def _account() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # an account without a name
        return ""


def _warn(server: Server) -> None:
    from ecat.web.serve import is_loopback

    if is_loopback(server.host):
        return
    tunnel = shell("ssh", "-L", f"{server.port}:127.0.0.1:{server.port}", "THIS_MACHINE")
    click.echo(
        f"ecat: listening on {server.host}, not only for this machine\n"
        f"  whoever reaches port {server.port} and has an address with a token can see and change everything here\n"
        f"  what is sent is not encrypted, the token neither\n"
        f"  try: leave out --host, and on the other machine: {tunnel}",
        err=True,
    )


def _open_browser(url: str) -> None:
    """Open the address where there is a screen; a browser in this terminal would be in the way."""
    import threading
    import webbrowser

    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
