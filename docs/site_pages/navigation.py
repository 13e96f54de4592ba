"""The list of pages shown beside pages that it does not contain; it is the same on all pages of a folder.

These are the source code and the files of the repository.
"""


def setup(app):
    """Draw this list once for each such folder, because drawing it takes longer than the rest of a page."""
    drawn: dict[str, str] = {}

    def share(app, name, template, context, doctree):
        if not name.startswith(("_modules/", "repository/")):
            return
        folder, draw = name.rpartition("/")[0], context["toctree"]

        def draw_once(**options):
            if folder not in drawn:
                drawn[folder] = draw(**options)
            return drawn[folder]

        context["toctree"] = draw_once

    app.connect("html-page-context", share, priority=100)  # before the theme asks for it
