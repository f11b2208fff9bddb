"""What every experiment says: which sentence it supports, and notes of metrics that a run has.

notes.json holds the metrics that the notes name, of a shortened study.
"""

import ast
import json
import re
from importlib import import_module
from pathlib import Path

import pytest

from wrenchsight.analyses.experiments.setups.machining_runs.machining_study import machining_notes
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.wording import filled

ROOT = Path(__file__).parents[3]
METRICS = json.loads(Path(__file__).with_name("notes.json").read_text(encoding="utf-8"))
BY_LOG = {"ur10e-trust"}  # their notes are lists of the logs that are there


@pytest.mark.parametrize("name", sorted(REGISTRY.entries()))
def test_the_first_line_quotes_the_sentence_that_it_supports(name):
    source = ROOT.joinpath(*REGISTRY.entries()[name].module.split(".")[1:]).with_suffix(".py")
    docstring = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8")))
    first_line = re.match(r'Supports (README|docs/[\w-]+\.md), "(.+)"\.\n', docstring)
    assert first_line, docstring.partition("\n")[0]
    page = ROOT / ("README.md" if first_line[1] == "README" else first_line[1])
    assert first_line[2] in " ".join(page.read_text(encoding="utf-8").split())


@pytest.mark.parametrize("name", sorted(set(REGISTRY.entries()) - BY_LOG))
def test_every_note_names_metrics_of_the_run(name):
    module = import_module(REGISTRY.entries()[name].module)
    notes = machining_notes(module.TASK) if hasattr(module, "TASK") else module.NOTES
    sentences = filled(notes, METRICS[name])
    assert len(sentences) == len(notes)
    for text in sentences:
        assert text.endswith(".") and "<" not in text and "–" not in text and len(text) < 500
