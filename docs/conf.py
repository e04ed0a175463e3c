"""The settings of the documentation site: `make site` builds it into `build/site`, a static
folder.
"""

from importlib.metadata import version as version_of

project = "opir"
author = "The opir authors"
copyright = author  # noqa: A001 - the name that Sphinx reads
release = version_of("opir-core")

extensions = ["myst_nb", "sphinx_design", "sphinx_gallery.gen_gallery"]
# README.md is the list of pages for those who read the folder: index.md shows it.
exclude_patterns = ["README.md", "**.ipynb_checkpoints", "gallery/*.ipynb"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "download_all_examples": False,
    "show_memory": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "write_computation_times": False,
}

html_context = {"default_mode": "auto"}
html_theme = "pydata_sphinx_theme"
html_title = f"opir {release}"
html_theme_options = {
    "show_prev_next": False,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "navbar_align": "left",
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 6,
}
