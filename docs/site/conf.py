"""Settings of the site: Sphinx reads them beside the pages that ``build.py`` has laid out."""

from importlib import metadata

project = "drivetwin"
author = "the drivetwin authors"
copyright = "the drivetwin authors, Apache-2.0"  # noqa: A001
version = release = metadata.version("drivetwin")

root_doc = "docs/index"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

myst_enable_extensions = ["colon_fence", "attrs_inline"]
myst_heading_anchors = 6

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "undoc-members": False}
add_module_names = False

html_theme = "furo"
html_title = f"drivetwin {release}"
html_copy_source = False
html_show_sphinx = False
html_use_index = True
# No request leaves the reader's machine: the theme's fonts are those of the system.
html_theme_options = {"sidebar_hide_name": False, "top_of_page_buttons": []}
smartquotes = False  # options keep their two dashes
pygments_style = "friendly"
pygments_dark_style = "monokai"
highlight_language = "none"
