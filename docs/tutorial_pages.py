"""Lets MkDocs run the tutorial: what its pages find, what they leave, and what must not pass.

The pages' own blocks are run by the plugin markdown-exec, each page in a folder of its own below
`out/tutorial`. Three directives, each alone on a line of a page:

    <!-- picture: FILE | WORDS -->   an image that the page has made
    <!-- moving: FILE | WORDS -->    a Meshcat recording that it has made
    <!-- recordings -->              which logs the page "real-arm" reads

A block that ends in an exception, and so a figure out of the bounds that a page asserts, is a
warning of markdown-exec, which `--strict` makes an error. A number that is none is one here, too.
"""

import html
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import tutorial_logs

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "out" / "tutorial"
PAGES = ("article", "real-arm", "your-arm")
_DIRECTIVE = re.compile(r"^<!-- (picture|moving): (\S+) \| (.+?) -->$", re.MULTILINE)
_NO_NUMBER = re.compile(r"\b(nan|inf)\b", re.IGNORECASE)
_TAGS = re.compile(r"<[^>]+>")

# A command's progress is no part of its result: shown only where the command fails.
_COMMAND = """#!/bin/sh
progress=$(mktemp)
"{python}" -m wrenchsight "$@" 2>"$progress"
code=$?
[ $code = 0 ] || cat "$progress"
rm "$progress"
exit $code
"""

_made: dict[str, set[str]] = {}
_words_of_logs = ""


def on_pre_build(**_: Any) -> None:
    """The hook of MkDocs: an empty folder for each page, and what its blocks take for granted."""
    global _words_of_logs
    _made.clear()
    shutil.rmtree(WORK, ignore_errors=True)
    for page in PAGES:
        (WORK / page).mkdir(parents=True)
    command = WORK / "bin" / "wrenchsight"
    command.parent.mkdir()
    command.write_text(_COMMAND.format(python=sys.executable), encoding="utf-8")
    command.chmod(0o755)
    if str(command.parent) not in os.environ["PATH"]:
        os.environ["PATH"] = f"{command.parent}{os.pathsep}{os.environ['PATH']}"
    os.environ["MPLBACKEND"] = "Agg"
    shutil.copy(ROOT / "models/robots/ur5e/robot.urdf", WORK / "your-arm" / "my_arm.urdf")
    logs, _words_of_logs = tutorial_logs.ur10e_logs(WORK / "logs")
    os.environ["LOGS"] = str(logs)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The hook of MkDocs: replaces the directives of one page."""
    name = tutorial_page(page.file.src_uri)
    if name is None:
        return markdown
    files = _made.setdefault(name, set())

    def replacement(match: "re.Match[str]") -> str:
        kind, file, words = match.groups()
        files.add(file)
        return frame(kind, file, words)

    markdown = markdown.replace("<!-- recordings -->", _words_of_logs)
    return _DIRECTIVE.sub(replacement, markdown)


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The hook of MkDocs: refuses a page that shows a number that is none."""
    if tutorial_page(page.file.src_uri) is not None:
        refuse_no_number(content, page.file.src_uri)
    return content


def on_post_build(config: Any, **_: Any) -> None:
    """The hook of MkDocs: puts beside each page what it has made."""
    for name, files in _made.items():
        for file in sorted(files):
            to = Path(config["site_dir"]) / "tutorial" / name / file
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(WORK / name / file, to)


def tutorial_page(source: str) -> str | None:
    """The name of a page that is run; None for any other."""
    path = Path(source)
    return path.stem if path.parent.name == "tutorial" and path.stem in PAGES else None


def frame(kind: str, file: str, words: str) -> str:
    """HTML that shows a file beside the page."""
    words = html.escape(words)
    if kind == "picture":
        shown = f'<img src="{file}" alt="{words}" loading="lazy">'
    else:
        shown = (
            f'<iframe src="{file}" title="{words}" loading="lazy" '
            'style="width: 100%; height: 28rem; border: 0"></iframe>'
        )
    return f'<figure style="width: 100%">{shown}<figcaption>{words}</figcaption></figure>'


def refuse_no_number(content: str, source: str) -> None:
    """Raises ValueError where a page's text holds "nan" or "inf" as a word."""
    text = _TAGS.sub(" ", content)
    if match := _NO_NUMBER.search(text):
        around = " ".join(text[max(0, match.start() - 60) : match.end() + 20].split())
        raise ValueError(f"{source}: a number that is none: ... {around} ...")
