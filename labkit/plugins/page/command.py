"""`labkit page`: the laboratory in a web page."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import Option
from labkit.cli.registry import command
from labkit.errors import InputError, Interrupted
from labkit.files.writable import make_folder


@command("page")
def page_command(
    *,
    output: Annotated[
        str | None, Option("write the page to this folder, for any web server, instead of opening it", "FOLDER")
    ] = None,
    pyodide: Annotated[
        str | None,
        Option("folder with Pyodide and its NumPy, to work without a network (default: the public one)", "FOLDER"),
    ] = None,
    wheel: Annotated[
        str | None, Option("wheel of labkit for browsers (default: built on first use, in some minutes)", "FILE")
    ] = None,
    port: Annotated[int | None, Option("port of the page (default: a free one)", "N")] = None,
    no_browser: Annotated[bool, Option("only print the address")] = False,
) -> None:
    """Opens the laboratory in a web page, in which the browser computes.

    Only this computer can open the page, until Ctrl-C. With --output it is written as files that any web server can
    offer to anybody.

    Examples:
        labkit page
        labkit page -o public/laboratory
    """
    from labkit.plugins.page.server import serve
    from labkit.plugins.page.site import wheel_for_browsers, write_site

    if pyodide is not None and not Path(pyodide, "pyodide.js").is_file():
        raise InputError("has no pyodide.js", field="pyodide", value=pyodide, allowed="a folder of Pyodide's release")
    built = Path(wheel) if wheel else wheel_for_browsers()
    if not built.is_file():
        raise InputError("does not exist", field="wheel", value=wheel, allowed="a wheel, or leave it out")
    if output is not None:
        write_site(make_folder(output, "--output"), built, pyodide)
        print(f"page: {Path(output, 'index.html')}")
        return
    with tempfile.TemporaryDirectory(prefix="labkit-page-") as folder:
        write_site(Path(folder), built, pyodide)
        with serve(Path(folder), port or 0) as server:
            address = f"http://127.0.0.1:{server.server_port}/"
            print(f"page: {address} (Ctrl-C ends it)", flush=True)
            if not no_browser:
                webbrowser.open(address)
            try:
                server.serve_forever()
            except Interrupted:
                raise
            except KeyboardInterrupt:  # the usual end
                return
