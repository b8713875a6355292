"""What MkDocs has to be told of this repository: a hook of mkdocs.yml.

The pages link to each other as they lie in the repository, so that they can be read there. On the site README.md is the
first page, the other pages of the root have places of their own, and every file and folder that a page links to, such
as an example, is a page too. Marks of listings that only the tests read are taken away.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).resolve().parents[1]
PLACES: Final = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
    "benchmarks/README.md": "benchmarks.md",
}
"""Pages outside of docs/, and where they are on the site."""

_LANGUAGES: Final = {
    ".md": "markdown",
    ".py": "python",
    ".sh": "bash",
    ".xml": "xml",
    ".toml": "toml",
    ".yml": "yaml",
    ".ipynb": "json",
}
_NOT_SEARCHED: Final = "---\nsearch:\n  exclude: true\n---\n\n"
_FENCE: Final = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_LINK: Final = re.compile(r"\]\((?![a-z]+:|#)(?P<path>[^)#\s]+)(?P<rest>#[^)\s]*)?\)")
_MARKS: Final = re.compile(r"^(```[a-z0-9]+)((?: +(?:no-run|continued|exit-\d+))+)(.*)$", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages outside of docs/, and what any page links to."""
    waiting = [*PLACES, *(f"docs/{file.src_uri}" for file in files if file.src_uri.endswith(".md"))]
    known = {*waiting, *(f"docs/{file.src_uri}" for file in files)}
    while waiting:
        path = waiting.pop()
        if not path.startswith("docs/"):
            files.append(File.generated(config, uri_of(path), content=content_of(path)))
        if path.endswith(".md") or (ROOT / path).is_dir():
            # What is not there is for MkDocs to complain of.
            linked = {each for each in links_of(content_of(path), base_of(path)) if (ROOT / each).exists()} - known
            known |= linked
            waiting += sorted(linked)
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Lead links to where things are on the site, and drop the tests' marks."""
    source = next((path for path, uri in PLACES.items() if uri == page.file.src_uri), f"docs/{page.file.src_uri}")
    if page.file.src_uri.startswith("files/"):
        source = page.file.src_uri.removeprefix("files/").removesuffix(".md")
    parts, last = [], 0
    for fence in _FENCE.finditer(markdown):
        parts += [relinked(markdown[last : fence.start()], source, page.file.src_uri), fence[0]]
        last = fence.end()
    return _MARKS.sub(r"\1\3", "".join((*parts, relinked(markdown[last:], source, page.file.src_uri))))


def relinked(text: str, source: str, uri: str) -> str:
    """The text of a page with its links as the site has them."""

    def lead(link: re.Match[str]) -> str:
        target = posixpath.relpath(uri_of(resolved(base_of(source), link["path"])), posixpath.dirname(uri) or ".")
        return f"]({target}{link['rest'] or ''})"

    return _LINK.sub(lead, text)


def links_of(text: str, base: str) -> Iterator[str]:
    """What a page links to, as paths in the repository."""
    for link in _LINK.finditer(_FENCE.sub("", text)):
        yield resolved(base, link["path"])


def resolved(base: str, path: str) -> str:
    """The path of a link in the repository."""
    return posixpath.normpath(posixpath.join(base, path))


def base_of(path: str) -> str:
    """The folder that the links of a page are relative to."""
    return path if (ROOT / path).is_dir() else posixpath.dirname(path)


def uri_of(path: str) -> str:
    """Where a file or folder of the repository is on the site."""
    if path in PLACES:
        return PLACES[path]
    if posixpath.dirname(path) in PLACES and path.endswith("README.md"):
        return PLACES[path]
    if (ROOT / path).is_dir() and f"{path}/README.md" in PLACES:
        return PLACES[f"{path}/README.md"]
    return path.removeprefix("docs/") if path.startswith("docs/") else f"files/{path}.md"


def content_of(path: str) -> str:
    """What stands on the page of a file or folder: a page's own text, a file as a listing, or what a folder holds."""
    place = ROOT / path
    if not place.is_dir():
        text = place.read_text(encoding="utf-8")
        if place.suffix == ".md":
            return text
        return f"{_NOT_SEARCHED}# {path}\n\n````{_LANGUAGES.get(place.suffix, '')}\n{text}\n````\n"
    inside = sorted(
        each.relative_to(place).as_posix()
        for each in place.rglob("*")
        if each.is_file() and not {"__pycache__", "types"} & set(each.parts) and each.suffix != ".pyc"
    )
    readme = place / "README.md"
    head = readme.read_text(encoding="utf-8") if readme.is_file() else f"# {path}\n"
    return head + "\n## Files\n\n" + "".join(f"- [{each}]({each})\n" for each in inside if each != "README.md")
