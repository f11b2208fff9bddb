"""Inputs that were met once and went wrong: each ends in one line, or in a reading."""

import re
from pathlib import Path

import pytest
from fuzzing.clean_inputs import LOG_FORMAT

pytestmark = pytest.mark.timeout(1800)  # where the kernels are not compiled yet
BUNDLED = Path(__file__).parents[2] / "models" / "robots" / "sts_sre4_600"
YAML = (BUNDLED / "robot.yaml").read_text()
URDF = (BUNDLED / "robot.urdf").read_text()
PLAIN_URDF = re.sub(r"<\?xml.*?\?>", "", URDF)


@pytest.fixture
def run(sandbox, tmp_path):
    """Runs a command in an empty folder; whatever it is given, it must end well."""

    def run(*arguments, expect=2):
        work = tmp_path / "work"
        work.mkdir()
        ending = sandbox.run(arguments, work)
        assert ending.fault() is None, f"{ending.fault()}: {ending.stderr[-3000:]}"
        assert ending.code == expect, ending.stderr + ending.stdout
        if expect == 2:
            assert ending.stdout == ""
        assert list(work.iterdir()) == [] or expect == 0  # nothing is left of a refusal
        return ending.stderr

    return run


@pytest.fixture
def estimate(run, clean):
    """`estimate` of the clean log by the clean robot, but for what is said."""

    def estimate(*options, log=None, robot=None, expect=2):
        prior = () if "--prior" in options else ("--prior", "30,2")
        return run(
            "estimate",
            log or clean.log,
            "--robot",
            robot or clean.robot,
            *prior,
            *options,
            "--out",
            "out",
            expect=expect,
        )

    return estimate


@pytest.fixture
def robot(tmp_path):
    """Writes a robot's folder."""

    def write(yaml=YAML, urdf=URDF, files=()):
        folder = tmp_path / "robot"
        folder.mkdir()
        for name, content in (("robot.yaml", yaml), ("robot.urdf", urdf), *files):
            data = content if isinstance(content, bytes) else content.encode()
            (folder / name).write_bytes(data)
        return folder

    return write


@pytest.fixture
def file(tmp_path):
    """Writes a file."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


# ---- limits that are kept ----


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(("--clearance", value) for value in ("1", "-1", "inf", "nan")),
        *(("--position-margin", value) for value in ("-3", "nan")),
        *(("--velocity-share", value) for value in ("1e9", "0", "nan")),
        *(("--torque-share", value) for value in ("inf", "0")),
        *(("--floor", value) for value in ("nan", "1e300")),
        *(("--periods", value) for value in ("100000000", "0", "-1")),
        *(("--base-frequency", value) for value in ("1e308", "nan", "1e-300")),
        *(("--harmonics", value) for value in ("100000", "0")),
        *(("--acceleration", value) for value in ("nan", "-1", "1e300", "1,2")),
    ],
)
def test_an_excitation_out_of_range(run, option, value):
    line = run("excite", "--robot", "sts_sre4_600", f"{option}={value}", "--out", "out")
    assert "expected" in line


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--prior-force-sd", "1e-200"),
        ("--prior-force-sd", "1e300"),
        ("--prior", "1e-200,1"),
        ("--k0", "1e-9"),
        ("--k0", "1,2"),
        ("--max-gap", "1e7"),
        ("--step", "1e-5"),
        ("--step", "1e-300"),
        ("--step", "1e5"),
    ],
)
def test_an_estimate_out_of_range(estimate, option, value):
    estimate(option, value)


# ---- memory and time ----


@pytest.mark.parametrize("name", ["x.2000000000", "q2000000000", "q" + "9" * 5000, "x." + "9" * 99])
def test_a_column_with_a_large_number(estimate, file, clean, name):
    head, _, rows = clean.log.read_text().partition("\n")
    words = head.split(",")
    words[3] = name
    estimate(log=file("log.csv", ",".join(words) + "\n" + rows))


@pytest.mark.parametrize(
    "columns",
    [
        "q{1..1000000000}",
        "q{1..60000}{1..60000}",
        "1-1000000000",
        "q{1..9}" + "{1..9}" * 30,
        "9" * 5000,
        "1-" + "9" * 5000,
    ],
)
def test_a_series_of_many_columns(estimate, file, columns):
    text = LOG_FORMAT.replace("q{1..6}", columns)
    assert "column" in estimate("--log-format", file("format.yaml", text))


@pytest.mark.parametrize(
    "line",
    [
        "skip_lines: 1000000000",
        "skip_lines: -1",
        f"skip_lines: 1{'0' * 400}",
        "num_columns: 1000000000",
        'extra: {a: {columns: "q{1..6}", shape: [-1, -6]}}',
        'extra: {a: {columns: "q{1..6}", shape: [0, 6]}}',
        'extra: {a: {columns: "q{1..6}", shape: [1000000000000, 6000000000000000]}}',
    ],
)
def test_a_description_of_no_log(estimate, file, line):
    estimate("--log-format", file("format.yaml", LOG_FORMAT + line + "\n"))


def test_merge_bombs(estimate, file):
    links = [f"b{k}: &b{k} {{<<: [{', '.join([f'*b{k - 1}'] * 9)}]}}" for k in range(1, 12)]
    bomb = "\n".join(["b0: &b0 {x: 1}", *links, "time: {<<: *b11}"])
    estimate("--log-format", file("format.yaml", bomb))


@pytest.mark.parametrize(
    "head", ["1,{rest}", "{digits},{rest}", "{digits}x,{rest}", "1.1.1,{rest}", "1e5x,{rest}"]
)
def test_a_first_cell_like_a_number(estimate, file, clean, head):
    first, _, rows = clean.log.read_text().partition("\n")
    text = head.format(digits="1" * 50_000, rest=first.partition(",")[2])
    estimate(log=file("log.csv", f"{text}\n{rows}"))


@pytest.mark.parametrize(
    "arguments",
    [
        ("estimate", "LOG", "--robot", "/dev/zero"),
        ("estimate", "LOG", "--robot", "ROBOT", "--model", "/dev/zero"),
        ("estimate", "LOG", "--robot", "ROBOT", "--log-format", "/dev/zero"),
        ("estimate", "/dev/zero", "--robot", "ROBOT"),
        ("estimate", "--config", "/dev/zero"),
        ("simulate", "--scenario", "/dev/zero"),
        ("place", "--task", "/dev/zero"),
        ("redundancy", "--task", "/dev/zero"),
        ("robot", "/dev/zero"),
    ],
)
def test_a_device_without_an_end(run, clean, arguments):
    words = {"LOG": clean.log, "ROBOT": clean.robot}
    command = [words.get(word, word) for word in arguments]
    run(*command, "--out", "out")


def test_a_urdf_that_is_such_a_device(run, robot):
    folder = robot(YAML.replace("urdf: robot.urdf", "urdf: /dev/zero"))
    assert "larger" in run("robot", "show", folder)


@pytest.mark.parametrize(
    "options",
    [
        *(("--samples", value) for value in ("1e30", str(10**15), str(10**30), "-1")),
        *(("--slice", "z=.3", "--points", value) for value in (str(10**9), str(10**30))),
        *(("--slice", value) for value in ("z=1,2", "z=nan", "w=1", "z", "z=1e300")),
        *(("--slice", "z=.3", "--cone-axis", value) for value in ("0,0", "0,0,0", "1e308,0,0")),
        ("--slice", "z=.3", "--cone-deg", "nan"),
    ],
)
def test_a_map_out_of_range(run, options):
    run("jcn-map", *options, "--out", "out")


def test_a_map_of_countless_samples(run, file):
    run("jcn-map", "--config", file("config.yaml", "num_samples: 1e308\n"), "--out", "out")


@pytest.mark.parametrize(
    ("command", "settings"),
    [
        ("jcn-map", "seed: -1\n"),
        ("place", "task: linear_path\nseed: -1\n"),
        ("excite", "robot: ur10e\nexcitation: {seed: -1.0}\n"),
        ("simulate", "seed: -0x1f\n"),
    ],
)
def test_a_seed_below_zero(run, file, command, settings):
    assert "0 or more" in run(command, "--config", file("config.yaml", settings), "--out", "out")


@pytest.mark.parametrize("time", ["1e6", "1e300"])
def test_a_leap_of_the_clock(estimate, file, clean, time):
    rows = clean.log.read_text().splitlines()
    rows[-1] = time + rows[-1][rows[-1].index(",") :]
    estimate("--max-gap", "10", log=file("log.csv", "\n".join(rows)))


# ---- tracebacks: YAML ----


@pytest.mark.parametrize(
    "value", ['!!python/object/apply:os.system ["true"]', '"\\ud800"', "[" * 3000 + "]" * 3000]
)
@pytest.mark.parametrize("key", ["payload", "urdf"])
def test_odd_yaml_in_a_robot(run, robot, key, value):
    """More of it stands in the tests of `models.files.configuration`."""
    run("robot", "show", robot(re.sub(rf"(?m)^{key}: .*$", lambda _: f"{key}: {value}", YAML)))


@pytest.mark.parametrize(
    "line", ["? {a: 1}\n: 2", "? [1]\n: 2", "<<: 3", "<<: [3]", "=: 3", "\0", "---\na: 1", "\ta: 1"]
)
def test_odd_keys_in_a_description(estimate, file, line):
    estimate("--log-format", file("format.yaml", LOG_FORMAT + line + "\n"))


@pytest.mark.parametrize(
    "body",
    [
        "estimator: {observer: {K_0: []}}",
        "estimator: {observer: {K_0: [1, 2, 3]}}",
        "estimator: {observer: {K_0: [-1]}}",
        "estimator: {reconstruction: {prior_force_sd: -1}}",
        "motion: !LineMotion {R_WE: [[1, 0, 0], [0, 1], [0, 0, 1]]}",
        "motion: !LineMotion {R_WE: [[1, 0], [0, 1]]}",
        "motion: !LineMotion {passes: 1000000000}",
        "motion: !JointSineMotion {amplitude: [1e308], frequency: [1e308]}",
        "time_step: 1e-300",
        "duration: 1e9",
        "duration: 1e-300",
        "duration: .inf",
        "force_torque_sensor: {force_noise_sd: 1e308}",
        "force_torque_sensor: {cutoff: 1e308}",
        "workpiece: {size: [0, 0, 0]}",
        "workpiece: !BladeConfig {mesh_size: 1e-9}",
        "duration: !!int abc",
        "? {a: 1}\n  : 2",
    ],
)
def test_an_odd_scenario(run, file, body):
    path = file(
        "scenario.yaml",
        f"A:\n  duration: 0.02\n  {body}\n".replace(
            "  duration: 0.02\n" if body.startswith("duration") else "\0", ""
        ),
    )
    run("simulate", "--scenario", path, "--no-recording", "--out", "out")


@pytest.mark.parametrize("name", ["!custom 1", "!HoldMotion a", "!!map x"])
def test_a_name_of_a_scenario_with_a_tag(run, file, name):
    path = file("scenario.yaml", f"{name}:\n  duration: 0.02\n")
    run("simulate", "--scenario", path, "--no-recording", "--out", "out")


# ---- tracebacks: robots ----

ODD_ROBOTS = {
    "com: [0.0, 0.0, 0.022]": ("com: [1e308, 0, 0]", "com: [1, 2]", "com: []"),
    "xyz: [0.0, 0.0, 0.07064]": ("xyz: [1e308, 0, 0]", "xyz: [0, 0]"),
    "mass: 0.6": ("mass: 1e308", "mass: -1"),
    "inertia: [0.00021, 0.00021, 0.00012, 0.0, 0.0, 0.0]": (
        "inertia: [1e308, 1e308, 1e308, 0, 0, 0]",
        "inertia: [0, 0, 0, 0, 0, 0]",
    ),
    "cylinder: [0.026, 0.032]": ("box: [0, 0, 0]", "box: [1, 2]", "sphere: -1", "sphere: 1e308"),
    "rgba: [0.16, 0.17, 0.18, 1.0]": ("rgba: [2, 0, 0, 1]", "rgba: [-1, 0, 0, 1]"),
    "payload: 4.0": (
        "payload: 1e308",
        "payload: 0",
        "payload: 4.0\ngravity: [1e308, 0, 0]",
        "payload: 4.0\nlocked_joints: {joint_6: 1e308}",
    ),
    "gear_ratio: 101.0": ("gear_ratio: 0", "gear_ratio: 1e308", "gear_ratio: 1e-300"),
    "rotor_inertia: 2.6e-5": ("rotor_inertia: 1e308", "rotor_inertia: -1"),
    "torque_constant: 0.47": ("torque_constant: 1e308", "torque_constant: 1e-308"),
    "current_resolution: 0.0026": (
        "current_sign: 7",
        "current_resolution: 1e308",
        "current_noise_sd: 1e308",
        "current_bandwidth: 1e-308",
        "effort_limit: 1e308",
        "effort_limit: 1e-308",
    ),
    "home: [0.0, -0.26, -0.567, 0.0, 0.827, 0.0]": ("home: []", "home: [1e308, 0, 0, 0, 0, 0]"),
}


@pytest.mark.parametrize(("old", "new"), [(old, n) for old, ns in ODD_ROBOTS.items() for n in ns])
def test_a_robot_beyond_all_robots(run, robot, old, new):
    assert old in YAML
    run("robot", "show", robot(YAML.replace(old, new, 1)))


# ---- tracebacks: URDF ----


@pytest.mark.parametrize("name", ["klingon", "utf-7", "cp037", "rot13", "hex", "idna", "shift_jis"])
def test_a_urdf_in_an_odd_encoding(run, robot, name):
    run("robot", "show", robot(urdf=f'<?xml version="1.0" encoding="{name}"?>{PLAIN_URDF}'))


def test_a_deep_urdf(run, robot):
    deep = "<a>" * 100_000 + "</a>" * 100_000
    run("robot", "show", robot(urdf=URDF.replace("</robot>", deep + "</robot>")), expect=0)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("velocity=", 'velocity="-1" x='),
        ("velocity=", 'velocity="nan" x='),
        ("<axis xyz=", '<axis xyz="0 0 0" x='),
        ("<axis xyz=", '<axis xyz="1e200 0 0" x='),
        ("<link", "\0<link"),
        ('type="revolute"', 'type="planar"'),
        ('name="joint_2"', 'name="joint_1"'),
        ("<robot", "<x><robot"),
    ],
)
def test_a_urdf_beyond_all_robots(run, robot, old, new):
    assert old in URDF
    run("robot", "show", robot(urdf=URDF.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("xyz=", 'xyz="1e308 0 0" x='),
        ("rpy=", 'rpy="1e308 0 0" x='),
        ("value=", 'value="1e308" x='),
        ("ixx=", 'ixx="1e308" x='),
    ],
)
def test_inertias_beyond_all_robots_are_refused_where_they_count(run, robot, old, new):
    """Of a link that moves: what stands on the floor may weigh what it likes."""
    base, moving = URDF.split("</link>", 1)
    file = robot(urdf=base + "</link>" + moving.replace(old, new, 1))
    run("simulate", "--robot", file, "--duration", "0.1", "--no-recording", "--out", "out")


@pytest.mark.parametrize("name", ["joint&#x9b;2", "joint_2\u202e", "a&#10;b"])
def test_a_name_that_cannot_be_printed(run, robot, name):
    urdf = URDF.replace('name="joint_2"', f'name="{name}"', 1)
    assert "cannot be printed" in run("robot", "show", robot(urdf=urdf))


def test_a_xacro_that_runs_code(run, robot):
    code = "(lambda: [c for c in ().__class__.__base__.__subclasses__()])()"
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">'
    text = f'{head}<xacro:property name="a" value="1"/><link name="${{{code}}}"/></robot>'
    assert "runs code of its author" in run("robot", "show", robot(urdf=text))


SOLID = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
MESHES = (
    ("words.obj", "v x y\nf 1 2 9\n\0"),
    ("point.obj", "v 0 0 0\nf 1 1 1\n"),
    ("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"),
    ("solid.obj", SOLID),
    ("half.gltf", '{"asset": 3, "buffers": ['),
    ("half.stl", "solid\n"),
    ("half.dae", "<COLLADA"),
)
SHAPES = (
    '<box size="0 0 0"/>',
    '<box size="1 2"/>',
    '<box size="inf 1 1"/>',
    "<box/>",
    '<box size="-1 1 1"/>',
    '<sphere radius="nan"/>',
    '<sphere radius="-1"/>',
    "<sphere/>",
    '<cylinder radius="1"/>',
    '<capsule radius="0" length="1"/>',
    "<ellipsoid/>",
    "<mesh/>",
    '<mesh filename="solid.obj" scale="0 0 0"/>',
    '<mesh filename="solid.obj" scale="x"/>',
    *(f'<mesh filename="{name}"/>' for name, _ in MESHES),
    '<mesh filename="/dev/zero.obj"/>',
    '<mesh filename="../../../etc/passwd"/>',
)


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_shapes_that_are_none_are_left_out(run, robot, kind):
    shapes = "".join(f"<{kind}><geometry>{shape}</geometry></{kind}>" for shape in SHAPES)
    link = re.search(r"<link name=[^>]*>", URDF).group()
    urdf = URDF.replace(link, link + shapes, 1)
    run("robot", "show", robot(urdf=urdf, files=MESHES), expect=0)


def test_materials_that_are_none_or_two(run, robot):
    box = '<visual><geometry><box size="1 1 1"/></geometry>{}</visual>'
    colour = '<material name="m"><color rgba="{}"/></material>'
    materials = ('<material name="nothing"/>', colour.format("1 0 0 1"), colour.format("0 1 0 1"))
    shapes = "".join(box.format(material) for material in (*materials, colour.format("1 x")))
    link = re.search(r"<link name=[^>]*>", URDF).group()
    urdf = URDF.replace(link, link + shapes, 1)
    twice = colour.format("1 0 0 1") + colour.format("0 0 1 1") + "<material/>"
    run("robot", "show", robot(urdf=urdf.replace("</robot>", twice + "</robot>")), expect=0)


def test_filter_groups_of_nobody(run, robot):
    group = '<drake:collision_filter_group name="g"><drake:member link="{}"/>{}'
    ignored = '<drake:ignored_collision_filter_group name="no such"/>'
    end = "</drake:collision_filter_group>"
    text = group.format("nobody", "") + end + group.format("flange", ignored) + end
    text += "<drake:collision_filter_group/></robot>"
    urdf = URDF.replace("<robot", '<robot xmlns:drake="http://drake.mit.edu"', 1)
    run("robot", "show", robot(urdf=urdf.replace("</robot>", text)), expect=0)


# ---- tracebacks: logs ----


@pytest.mark.parametrize("where", ["between two lines", "in a line", "after a cell"])
def test_a_lone_carriage_return(estimate, file, clean, where):
    lines = clean.log.read_text().split("\n")
    text = {
        "between two lines": "\n".join(lines[:100]) + "\r" + "\n".join(lines[100:]),
        "in a line": "\n".join(
            [*lines[:100], lines[100][:7] + "\r" + lines[100][7:], *lines[101:]]
        ),
        "after a cell": "\n".join([*lines[:9], lines[9].replace(",", "\r,", 1), *lines[10:]]),
    }[where]
    assert "carriage return" in estimate(log=file("log.csv", text))


def test_lines_that_end_with_a_carriage_return_each(estimate, file, clean):
    text = clean.log.read_text().replace("\n", "\r")
    estimate(log=file("log.csv", text), expect=0)


@pytest.mark.parametrize(
    ("letter", "factor", "word"),
    [
        ("q", 0.0, "stands still"),
        ("q", 3.14159 / 180.0, "degrees per second"),
    ],
)
def test_a_signal_of_all_joints_in_another_unit(estimate, file, clean, letter, factor, word):
    head, *rows = [line.split(",") for line in clean.log.read_text().splitlines()]
    for row in rows:
        for k, name in enumerate(head):
            if name.startswith(letter):
                row[k] = repr(float(row[k]) * factor)
    text = "\n".join(",".join(row) for row in (head, *rows))
    assert word in estimate(log=file("log.csv", text))


def test_lines_that_end_with_both(estimate, file, clean):
    text = clean.log.read_text().replace("\n", "\r\n")
    estimate(log=file("log.csv", text), expect=0)


# ---- the command line ----


@pytest.mark.parametrize(
    "arguments",
    [
        ("nope",),
        ("estimate",),
        ("estimate", "--nope"),
        ("estimate", "x.csv"),
        ("--nope",),
        ("estimate", "x.csv", "--robot"),
        ("study", "--jobs", "0"),
        ("study", "--seed", "x"),
        ("simulate", "--duration", "abc"),
        ("jcn-map", "--samples", "-1"),
        ("robot",),
        ("robot", "show"),
        ("robot", "a", "b", "c"),
        ("payload", "x.csv"),
        ("identify",),
        ("estimate", "x.csv", "--robot", "ur10e", "extra"),
        ("study", "--quick=3"),
        ("redundancy",),
        ("place",),
        ("place", "--task", "nope"),
        ("simulate", "--scenario", ""),
        ("estimate", "", "--robot", "ur10e"),
        ("robot", ""),
        ("estimate", "\x1b[31m", "--x"),
    ],
)
def test_a_usage_error_is_one_line(run, arguments):
    run(*arguments)


@pytest.mark.parametrize("out", ["a\0b"[:1] * 5000, "/dev/null", "/proc/x", "/dev/null/x"])
def test_a_folder_that_cannot_be(run, clean, out):
    run("estimate", clean.log, "--robot", clean.robot, "--out", out)


def test_a_folder_whose_name_is_no_text(estimate, tmp_path, run, clean):
    name = b"\xff\xfe\x1b[31m".decode("utf-8", "surrogateescape")
    prior = ("--prior", "30,2")
    run("estimate", clean.log, "--robot", clean.robot, *prior, "--out", name, expect=0)


# ---- a model that is not this robot's ----


def test_another_robot_only_when_it_is_meant(run, robot, clean, file):
    log = ("estimate", clean.log, "--prior", "30,2", "--out", "out", "--no-check")
    other = robot(YAML.replace("torque_constant: 0.47", "torque_constant: 0.94", 1))
    model = ("--robot", other, "--model", clean.folder / "model.yaml")
    assert "--other-robot" in run(*log, *model)
    (other.parent / "work").rmdir()
    run(*log, *model, "--other-robot", expect=0)
    out = other.parent / "work" / "out"
    assert "other_robot: true" in (out / "config.yaml").read_text()
    assert "torque_per_ampere: the model was identified with" in (out / "metrics.json").read_text()


def test_an_absurd_tick_does_not_stay_in_the_watch_over_friction(estimate, file, clean):
    rows = clean.log.read_text().splitlines()
    cells = rows[300].split(",")
    cells[8] = "5.0"  # rad/s, in one tick: missing, and so not a number where the log is resampled
    estimate(log=file("log.csv", "\n".join([*rows[:300], ",".join(cells), *rows[301:]])), expect=0)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"'shape': (500,", b"'shape': {500,"),
        (b"{'descr'", b"('descr'"),
        (b"False", b"Fals\\"),
        (b"NUMPY\x01", b"NUMPY\x7f"),
        (b"PK\x01\x02-\x03-", b"PK\x01\x02-\x03\xff"),
    ],
)
def test_a_damaged_array(estimate, file, clean, old, new):
    data = (clean.folder / "log.npz").read_bytes()
    assert "npz" in estimate(log=file("log.npz", data.replace(old, new)))


@pytest.mark.parametrize("command", ["identify", "refresh", "payload", "estimate"])
def test_a_description_without_currents(run, clean, file, command):
    text = "".join(line for line in LOG_FORMAT.splitlines(True) if "current" not in line)
    described = ("--robot", clean.robot, "--log-format", file("format.yaml", text), "--out", "out")
    model = clean.folder / "model.yaml"
    line = {
        "identify": lambda: run("identify", clean.log, *described),
        "refresh": lambda: run("identify", clean.log, "--refresh", model, *described),
        "payload": lambda: run("payload", clean.log, "--model", model, *described),
        "estimate": lambda: run("estimate", clean.log, "--prior", "30,2", *described),
    }[command]()
    assert "holds no motor currents" in line


def test_branches_that_collide_side_by_side(run, file, clean):
    text = (clean.folder / "redundancy.yaml").read_text()
    path = file("redundancy.yaml", text.replace("start: [0.92, 0.2]", "start: [0.92, -0]"))
    assert "no collision-free trajectory" in run("redundancy", "--task", path, "--out", "out")


def test_a_covariance_that_is_symmetric_but_for_rounding(estimate, file, clean):
    text = (clean.folder / "model.yaml").read_text()
    head, _, tail = text.partition("residual_covariance:")
    row = re.search(r"- \[0\.0, (0\.0)", tail)
    tail = tail[: row.start(1)] + "1e-308" + tail[row.end(1) :]
    estimate("--model", file("model.yaml", f"{head}residual_covariance:{tail}"), expect=0)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("tool_axis: [0.7071067811865476, 0.0,", "tool_axis: [0.7071067811865476, 1e308,"),
        ("end: [0.9, 0.25]", "end: [1e308, 0.25]"),
    ],
)
def test_a_number_of_a_redundancy_task_that_no_length_has(run, clean, file, old, new):
    text = (clean.folder / "redundancy.yaml").read_text()
    assert old in text
    path = file("redundancy.yaml", text.replace(old, new))
    assert "1e+308, expected" in run("redundancy", "--task", path, "--out", "out")


@pytest.mark.parametrize("key", ["inertial_parameters", "reflected_inertia", "viscous"])
def test_a_number_of_a_model_that_no_arm_has(estimate, clean, file, key):
    text = (clean.folder / "model.yaml").read_text()
    spoilt, count = re.subn(rf"({key}:[\s\[-]*)[-0-9.e]+", r"\g<1>1e308", text, count=1)
    assert count == 1
    assert "1e+308, expected" in estimate("--model", file("model.yaml", spoilt))
