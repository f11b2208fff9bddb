"""A constant is a noun with what it bounds: MIN_SAMPLES, not FEWEST.

A number that is named by one word says neither what it is compared with nor in which direction; a
reader has to look at every use. Exempt are names of rows, columns, codes and bits, which count up
or are powers of two and stand beside each other, and the few words below.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("models", "systems", "diagrams", "analyses")
FILES = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]

ALLOWED = {
    "ORDER": "place of a command in the help, as all command modules have it",
    "X": "axis of a frame",
    "Y": "axis of a frame",
    "Z": "axis of a frame",
}
# Words that bound something unsaid, whatever the constant holds.
ADJECTIVES = set(
    """
    alike clear determined early enough far farthest fastest fewest finest furthest heavy largest
    late latest least left little longest loud most mostly near nearer often poor prompt quiet rare
    same shortest slow slowest smallest steepest still strong strongest sure tight unexplained
    unlikely weak wider widest
    """.upper().split()
)


def _constants(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Name and value of every constant at a module's top level but rows, columns and codes."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        for target in targets:
            if isinstance(target, ast.Name):
                yield target.id, value
            elif isinstance(target, ast.Tuple) and not _counts(value):
                values = value.elts if isinstance(value, ast.Tuple) else [value] * len(target.elts)
                for name, one in zip(target.elts, values, strict=False):
                    if isinstance(name, ast.Name):
                        yield name.id, one


def _counts(value: ast.expr) -> bool:
    """Whether values that are unpacked are range(...), or whole numbers and slices in order."""
    if isinstance(value, ast.Call):
        return ast.unparse(value.func) == "range"
    if not isinstance(value, ast.Tuple):
        return False
    starts = []
    for one in value.elts:
        first = one.args[0] if isinstance(one, ast.Call) and one.args else one
        if not (isinstance(first, ast.Constant) and isinstance(first.value, int)):
            return False
        starts.append(0 if isinstance(one, ast.Call) and len(one.args) == 1 else first.value)
    return starts == sorted(starts)


def _is_number(value: ast.expr) -> bool:
    """Whether a value is made of number literals alone, by arithmetic, and is no bit of a field."""
    if _is_bit(value):
        return False
    if isinstance(value, ast.Tuple):
        return bool(value.elts) and all(_is_number(one) for one in value.elts)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) or _is_number(value.right)
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def _is_bit(value: ast.expr) -> bool:
    """Whether it is 1 << k."""
    is_shift = isinstance(value, ast.BinOp) and isinstance(value.op, ast.LShift)
    return is_shift and ast.unparse(value).startswith("1 <<")


def bare_names(source: str) -> list[str]:
    """Constants of a module whose one-word name does not say what they bound."""
    return [
        name
        for name, value in _constants(ast.parse(source))
        if name.isupper()
        and "_" not in name.strip("_")
        and name not in ALLOWED
        and (_is_number(value) or name.strip("_") in ADJECTIVES)
        and not _is_bit(value)
    ]


def test_a_number_is_named_by_what_it_bounds() -> None:
    bare = {
        str(file.relative_to(ROOT)): names
        for file in FILES
        if (names := bare_names(file.read_text(encoding="utf-8")))
    }
    assert bare == {}


def test_the_rule_tells_bounds_from_rows() -> None:
    assert bare_names("FEWEST = 20\nMARGIN: float = 0.5\n_STEP = 2 * 1e-3") == [
        "FEWEST",
        "MARGIN",
        "_STEP",
    ]
    assert bare_names("LOUD, QUIET = 2.0, 0.1\nSIZES = (1, 3)\nSAME = object()") == [
        "LOUD",
        "QUIET",
        "SIZES",
        "SAME",
    ]
    assert bare_names("Q, V = 0, 1\nFORCE, NORMAL = 0, slice(1, 4)\nA, B = range(2)") == []
    assert bare_names("MIN_SAMPLES = 20\nORDER = 15\nSETTLING = 1 << 3\nFOLDER = 'ur10e'") == []
