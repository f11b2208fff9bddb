"""The notes of every experiment name metrics that a run has.

notes.json holds the metrics that the notes name, of a shortened study.
"""

import json
from importlib import import_module
from pathlib import Path

import pytest

from wrenchsight.analyses.experiments.setups.machining_runs.machining_study import machining_notes
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.wording import filled

METRICS = json.loads(Path(__file__).with_name("notes.json").read_text(encoding="utf-8"))
BY_LOG = {"observers", "ur10e-trust"}  # their notes are lists of the logs that are there


@pytest.mark.parametrize("name", sorted(set(REGISTRY.entries()) - BY_LOG))
def test_every_note_names_metrics_of_the_run(name):
    module = import_module(REGISTRY.entries()[name].module)
    notes = machining_notes(module.TASK) if hasattr(module, "TASK") else module.NOTES
    sentences = filled(notes, METRICS[name])
    assert len(sentences) == len(notes)
    for text in sentences:
        assert text.endswith(".") and "<" not in text and "–" not in text and len(text) < 500
