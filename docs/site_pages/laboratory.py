"""Puts the page of `labkit page` into the site, as page/index.html, with links to the site's theory."""

from pathlib import Path

from labkit.errors import notice
from labkit.plugins.page.site import stored_wheel, write_site


def setup(app):
    """Write the page at the end of a build, before the links of the site are checked."""

    def write(app, error):
        if error is not None or app.builder.name != "html":
            return
        wheel = stored_wheel()
        write_site(Path(app.outdir, "page"), wheel, theory="../theory.html")
        if wheel is None:
            notice("page/index.html computes nothing yet: run `labkit page -o FOLDER` once, then build the site again")

    app.connect("build-finished", write)
