"""MkDocs' hooks for the pages of docs/ as a site (mkdocs.yml): files of the repository that pages link to come with it, in
`repository/`, and its navigation leads to the reference of the headers, which CMake's target `reference` puts beside it."""

import os
import posixpath
import re

from mkdocs.structure.files import File, InclusionLevel
from mkdocs.structure.nav import Link

LINK = re.compile(r"\]\(([^)#\s]+)")


def outside(source, target):
    """The path of a link's target from the root of the repository, where it is a file outside docs/; else None."""
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
    return path if "://" not in target and not path.startswith("docs/") and os.path.isfile(path) else None


def on_files(files, config):
    """Adds what the pages link to outside docs/, and what these files link to in turn."""
    root = os.path.dirname(config.config_file_path)
    os.chdir(root)
    waiting = [posixpath.join("docs", file.src_uri) for file in files.documentation_pages()]
    seen = set()
    while waiting:
        source = waiting.pop()
        if not source.endswith(".md"):
            continue
        with open(source, encoding="utf-8") as file:
            targets = LINK.findall(file.read())
        for path in {outside(source, target) for target in targets} - seen - {None}:
            seen.add(path)
            waiting.append(path)
            files.append(File.generated(config, "repository/" + path, abs_src_path=os.path.join(root, path), inclusion=InclusionLevel.NOT_IN_NAV))
    return files


def on_page_markdown(markdown, page, config, files):
    """Has links out of docs/ lead to the site's copies, and those of copies back."""
    own = page.file.src_uri
    copied = own.startswith("repository/")
    source = own[len("repository/") :] if copied else "docs/" + own

    def lead(match):
        target = match[1]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if copied and path.startswith("docs/"):
            target = posixpath.relpath(path[len("docs/") :], posixpath.dirname(own))
        elif outside(source, target):
            target = posixpath.relpath("repository/" + path, posixpath.dirname(own) or ".")
        return "](" + target

    return LINK.sub(lead, markdown)


def on_nav(nav, config, files):
    """Adds the reference of the headers as the last entry."""
    nav.items.append(Link("Reference of the headers", "reference/index.html"))
    return nav
