"""Ways to spoil a file: each takes its bytes and a generator of random numbers."""

import random
import re
from collections.abc import Callable, Sequence

Mutator = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    "0",
    "-0",
    "1",
    "-1",
    "nan",
    "inf",
    "-inf",
    ".nan",
    ".inf",
    "1e308",
    "-1e308",
    "1e-308",
    "1e154",
    "1e30",
    "-1e30",
    "999999",
    "-999999",
    "1e9",
    "1e12",
    "1e-9",
    "1e-200",
    "4294967296",
    "9223372036854775808",
    "1e400",
    "0x1f",
    "1_000",
    "1,5",
    "--1",
    "1e",
    "1e+",
    "٣",
    "1.0.0",
    "9" * 400,
    "1" * 5000,
    "0." + "0" * 400 + "1",
    "1000",
    "-1000",
    "3.14159265358979",
    "57.3",
)
WORDS = (
    "",
    " ",
    "abc",
    "~",
    "null",
    "true",
    "[]",
    "{}",
    "=",
    "<<",
    "\\0",
    "\\x1b[31m",
    "é",
    "\u202e",
    "!!int abc",
    "!!python/object/apply:os.system [id]",
    "!custom 1",
    "*a",
    "&a b",
    "? x",
    "- x",
    "../../../etc/passwd",
    "/dev/zero",
    "/dev/null",
    "a" * 3000,
    "%s%n",
    '"',
    "'",
    "\t",
    "#",
    "|",
    "!!timestamp 2020-13-45",
    "!!bool maybe",
    "!!binary =",
    "'\\ud800'",
    "2020-01-01",
    "{a: 1}",
)


def _place(data: bytes, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def flip_bits(data: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 50))):
        if spoilt:
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def set_bytes(data: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(data)
    for _ in range(rng.choice((1, 2, 8))):
        if spoilt:
            spoilt[rng.randrange(len(spoilt))] = rng.choice((0, 10, 13, 34, 44, 58, 127, 255))
    return bytes(spoilt)


def cut(data: bytes, rng: random.Random) -> bytes:
    return data[: _place(data, rng)]


def cut_out(data: bytes, rng: random.Random) -> bytes:
    begin = _place(data, rng)
    return data[:begin] + data[begin + rng.choice((1, 4, 16, 256, 4096)) :]


def repeat(data: bytes, rng: random.Random) -> bytes:
    begin = _place(data, rng)
    part = data[begin : begin + rng.choice((1, 8, 64, 1024))]
    return data[:begin] + part * rng.choice((2, 3, 50)) + data[begin + len(part) :]


def put_in(data: bytes, rng: random.Random) -> bytes:
    begin = _place(data, rng)
    return data[:begin] + rng.choice((*NUMBERS, *WORDS)).encode("utf-8") + data[begin:]


def in_another_encoding(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("utf-8", "replace")
    name = rng.choice(("utf-16", "utf-8-sig", "utf-32", "cp037", "utf-7"))
    return text.encode(name)


def other_line_ends(data: bytes, rng: random.Random) -> bytes:
    return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\0", b"\n\r", b"\x0b")))


def shuffle_lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = (rng.randrange(len(lines)) for _ in range(2))
    choice = rng.randrange(5)
    if choice == 0:
        lines[a], lines[b] = lines[b], lines[a]
    elif choice == 1:
        del lines[min(a, b) : min(a, b) + rng.choice((1, 1, 5, 50))]
    elif choice == 2:
        lines.insert(a, lines[b])
    elif choice == 3:
        lines[min(a, b) : max(a, b)] = lines[min(a, b) : max(a, b)][::-1]
    else:
        lines = lines[: a + 1] + lines
    return b"\n".join(lines)


ANY: Sequence[Mutator] = (flip_bits, set_bytes, cut, cut_out, repeat, put_in)
LINES: Sequence[Mutator] = (*ANY, in_another_encoding, other_line_ends, shuffle_lines)


# ---- tables ----


def _rows(data: bytes) -> list[list[str]]:
    return [line.split(",") for line in data.decode("utf-8").rstrip("\n").split("\n")]


def _bytes(rows: list[list[str]]) -> bytes:
    return ("\n".join(",".join(row) for row in rows) + "\n").encode("utf-8", "surrogatepass")


def odd_cell(data: bytes, rng: random.Random) -> bytes:
    rows = _rows(data)
    for _ in range(rng.choice((1, 1, 3, 30))):
        row = rng.randrange(len(rows))
        rows[row][rng.randrange(len(rows[row]))] = rng.choice((*NUMBERS, *NUMBERS, *WORDS))
    return _bytes(rows)


def scaled_cell(data: bytes, rng: random.Random) -> bytes:
    """One tick, or some, of a number far from those around it."""
    rows = _rows(data)
    column, begin = rng.randrange(1, len(rows[0])), rng.randrange(1, len(rows))
    factor = rng.choice((-1.0, 10.0, 1e3, -1e3, 1e6, 1e12, 1e100, 57.3))
    more = rng.choice((0.0, 0.0, 1.0, 100.0))
    for row in rows[begin : begin + rng.choice((1, 1, 2, 10, 100))]:
        row[column] = repr(float(row[column]) * factor + more)
    return _bytes(rows)


def scaled_column(data: bytes, rng: random.Random) -> bytes:
    """A wrong unit or sign of one signal."""
    rows = _rows(data)
    letter = rng.choice("tqvi")
    columns = [k for k, name in enumerate(rows[0]) if name.startswith(letter)]
    if rng.random() < 0.3:
        columns = [rng.choice(columns)]
    factor = rng.choice((-1.0, 1e3, 1e-3, 57.29577951, 1 / 57.29577951, 1e-6, 1e6, 0.0, 9.549, 100))
    for row in rows[1:]:
        for k in columns:
            row[k] = repr(float(row[k]) * factor)
    return _bytes(rows)


def stuck_column(data: bytes, rng: random.Random) -> bytes:
    """A signal that holds its value for some time, or to the end."""
    rows = _rows(data)
    column, begin = rng.randrange(1, len(rows[0])), rng.randrange(1, len(rows))
    for row in rows[begin : begin + rng.choice((5, 50, 500))]:
        row[column] = rows[begin][column]
    return _bytes(rows)


def other_columns(data: bytes, rng: random.Random) -> bytes:
    rows = _rows(data)
    a, b = (rng.randrange(len(rows[0])) for _ in range(2))
    choice = rng.randrange(5)
    for row in rows:
        if choice == 0:
            row[a], row[b] = row[b], row[a]
        elif choice == 1:
            del row[a]
        elif choice == 2:
            row.append(row[a])
        elif choice == 3 and row is not rows[0]:
            row[a], row[b] = row[b], row[a]
        elif choice == 4 and row is not rows[0]:
            row[a] = row[b]
    return _bytes(rows)


def odd_header(data: bytes, rng: random.Random) -> bytes:
    rows = _rows(data)
    name = rng.choice(("x.2000000000", "q7", "q0", "Q1", "t", "i1", "", "tau1", "a b", "é", *WORDS))
    rows[0][rng.randrange(len(rows[0]))] = name
    return _bytes(rows)


def odd_clock(data: bytes, rng: random.Random) -> bytes:
    rows = _rows(data)
    begin = rng.randrange(1, len(rows))
    choice = rng.randrange(4)
    shift = rng.choice((1e-4, 0.01, 0.5, 1e3, 1e9, -0.01, -1.0))
    for k, row in enumerate(rows[1:], start=1):
        t = float(row[0])
        if choice == 0 and k >= begin:
            row[0] = repr(t + shift)
        elif choice == 1:
            row[0] = repr(t + 1e-4 * rng.random())
        elif choice == 2 and k == begin:
            row[0] = rows[max(1, k - 1)][0]
        elif choice == 3:
            row[0] = f"{t:.2f}"
    return _bytes(rows)


def other_separator(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.5:
        return data.replace(b",", rng.choice((b";", b"\t", b" ", b"|", b",,")))
    return data.replace(b",", b";").replace(b".", b",")


def lists_in_cells(data: bytes, rng: random.Random) -> bytes:
    """Each signal as a list in one cell; one of them perhaps broken."""
    rows = _rows(data)
    begin, end = rng.choice(("[]", "()", "{}", ("array([", "])"), ("[", "")))
    between = rng.choice((", ", " ", ";", " \n "))
    n = (len(rows[0]) - 1) // 3
    written = [["time", "position", "velocity", "current"]]
    for row in rows[1:]:
        parts = [row[1 + k * n : 1 + (k + 1) * n] for k in range(3)]
        if rng.random() < 0.001:
            parts[rng.randrange(3)].append(rng.choice((*NUMBERS, *WORDS)))
        cells = [f'"{begin}{between.join(part)}{end}"' for part in parts]
        written.append([row[0], *cells])
    return _bytes(written)


def words_around_the_table(data: bytes, rng: random.Random) -> bytes:
    """Lines above the table, units below the header, dates for times, names of words."""
    rows = _rows(data)
    if rng.random() < 0.5:
        rows.insert(1, [rng.choice(("s", "rad", "deg", "A", "[mA]", "", *WORDS)) for _ in rows[0]])
    if rng.random() < 0.3:
        for row in rows[1:]:
            row[0] = f"2024-02-{rng.choice((28, 30))} 12:00:{row[0][:9]}"
    if rng.random() < 0.5:
        text = rng.choice(
            ("Joint {} position [deg]", "actual_q_{}", "{}", "A{}.pos", "[{}", "({})")
        )
        rows[0] = [rows[0][0], *(text.format(name) for name in rows[0][1:])]
    above = [[rng.choice((*WORDS, "Robot: x", "Rate [Hz],100"))] for _ in range(rng.randrange(4))]
    return _bytes([*above, *rows])


TABLE: Sequence[Mutator] = (
    *LINES,
    odd_cell,
    odd_cell,
    scaled_cell,
    scaled_cell,
    scaled_cell,
    scaled_column,
    stuck_column,
    other_columns,
    odd_header,
    odd_clock,
    other_separator,
    lists_in_cells,
    words_around_the_table,
)


# ---- YAML and XML ----


def _replace_one(pattern: str, data: bytes, rng: random.Random, new: Sequence[str]) -> bytes:
    text = data.decode("utf-8")
    matches = list(re.finditer(pattern, text))
    if not matches:
        return data
    for match in rng.sample(matches, min(len(matches), rng.choice((1, 1, 1, 3)))):
        text = text[: match.start(1)] + rng.choice(new) + text[match.end(1) :]
        if len(matches) > 1:
            break
    return text.encode("utf-8", "surrogatepass")


def odd_value(data: bytes, rng: random.Random) -> bytes:
    return _replace_one(r":[ ]+([^\n#]+)", data, rng, (*WORDS, *NUMBERS))


def odd_number(data: bytes, rng: random.Random) -> bytes:
    return _replace_one(r"(?<![\w.])(-?\d+\.?\d*(?:e[+-]?\d+)?)", data, rng, NUMBERS)


def odd_key(data: bytes, rng: random.Random) -> bytes:
    return _replace_one(r"(\w+):", data, rng, (*WORDS, "name", "urdf", "x"))


def odd_attribute(data: bytes, rng: random.Random) -> bytes:
    return _replace_one(r'="([^"]*)"', data, rng, (*NUMBERS, *(w.replace('"', "") for w in WORDS)))


def odd_element(data: bytes, rng: random.Random) -> bytes:
    return _replace_one(r"<(/?\w+)", data, rng, ("link", "joint", "x", "mesh", "/robot", "origin"))


YAML: Sequence[Mutator] = (
    *LINES,
    odd_value,
    odd_value,
    odd_number,
    odd_number,
    odd_number,
    odd_key,
)
XML: Sequence[Mutator] = (*LINES, odd_attribute, odd_attribute, odd_attribute, odd_element)
BINARY: Sequence[Mutator] = ANY


def spoilt(data: bytes, kinds: Sequence[Mutator], rng: random.Random) -> tuple[bytes, str]:
    """`data` after one mutation, or two, and their names."""
    names = []
    for _ in range(rng.choice((1, 1, 1, 2))):
        mutator = rng.choice(kinds)
        try:
            data = mutator(data, rng)
        except (ValueError, IndexError):  # of a table that is none any more
            continue
        names.append(mutator.__name__)
    return data, "+".join(names)
