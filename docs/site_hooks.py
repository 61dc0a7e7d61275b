"""What the site needs besides MkDocs' own: pages from outside `docs/`, links that hold on GitHub too, formulas.

A link of a page is the one that works in the repository. Here it is turned into the site's, or, where it leads to
source code, into its text. One that leads nowhere ends the build.
"""

import html
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "SECURITY.md": "security.md"}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_CODE = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the repository's top folder, and the pictures of `scenarios/`."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    for picture in sorted([*ROOT.glob("scenarios/*.png"), *ROOT.glob("scenarios/*.gif")]):
        files.append(File.generated(config, f"scenarios/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The site's links in place of the repository's."""
    source = Path(page.file.abs_src_path).resolve().relative_to(ROOT)
    parts = _CODE.split(markdown)  # code at the odd places
    parts[::2] = [_LINK.sub(lambda found: _link(found, source, page.file.src_uri, files), text) for text in parts[::2]]
    return "".join(parts)


def on_page_content(content: str, **_: object) -> str:
    """Formulas as MathML, which browsers show without a script."""
    return _FORMULA.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    return convert(html.unescape(found[2]), display="inline" if found[1] == "span" else "block")


def _link(found: re.Match[str], source: Path, page: str, files: Files) -> str:
    """A link of `source`, a file of the repository, as it is to stand on the site's `page`."""
    mark, text, target = found.groups()
    path, hash_, anchor = target.partition("#")
    if not path or "://" in path or path.startswith("mailto:"):
        return found[0]
    wanted = posixpath.normpath((source.parent / path).as_posix())
    if not (ROOT / wanted).exists():
        raise PluginError(f"{source}: the link to {target} leads nowhere")
    on_site = PAGES.get(wanted, wanted.removeprefix("docs/"))
    if files.get_file_from_path(on_site) is None:
        return text  # source code and the like: no part of the site
    return f"{mark}[{text}]({posixpath.relpath(on_site, posixpath.dirname(page) or '.')}{hash_}{anchor})"
