"""Every command of every document works in a fresh clone, word for word.

A command is run to its end where that is quick. Where it takes minutes it is started, and interrupted at its first sign
of work. Where that is too long as well, or asks for a cluster, the command's own grammar and checks read it. `CHECKS`
says which; a command that it does not know fails.
"""

from __future__ import annotations

import re
import shlex
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import click_lines
import pytest
import recorded_study
from clone import Clone
from documents import Code, blocks, commands, documents, inline
from processes import free_port

from envs.errors import INTERRUPTED
from freemesh_ray import config
from freemesh_ray.cli import command as cli
from freemesh_ray.policies.policy import DEFAULT

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what Ray and MLflow import
COMMANDS = [command for document in documents() for command in commands(document)]
INLINE = [code for document in documents() for code in inline(document)]
#: Where the documents' service listens.
SERVED = "127.0.0.1:8000"
#: How long commands begin -> a regular expression of the line that tells that they work.
SIGNS = {
    "make train": r"^T1 +step \d",
    ".venv/bin/freemesh study algorithms": r"^\d+ trials of",
    ".venv/bin/freemesh compare D7 ": r"^D7 ",
    ".venv/bin/freemesh paper quality": r"^D7 ",
}


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    return Clone(tmp_path_factory.mktemp("clone") / "freemesh-ray")


@pytest.fixture(scope="module")
def service(clone: Clone) -> Iterator[str]:
    """Address of the documents' service, which ends as they say; not on its usual port, which may be taken."""
    port = free_port()
    line = f".venv/bin/freemesh serve --port {port}"
    with clone.started(line, rf"^http://127\.0\.0\.1:{port} ") as process:
        yield f"127.0.0.1:{port}"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
    assert process.returncode == INTERRUPTED


Check = Callable[[str, pytest.FixtureRequest], None]


def clone_of(request: pytest.FixtureRequest) -> Clone:
    found: Clone = request.getfixturevalue("clone")
    return found


def runs(line: str, request: pytest.FixtureRequest) -> None:
    """To its end, and writes what it is told to write."""
    clone = clone_of(request)
    written = [clone.folder / name for name in re.findall(r" -o (\S+)", line)]
    for path in written:
        path.unlink(missing_ok=True)
    ended = clone.run(line)
    assert ended.code == 0, ended.output
    assert all(path.stat().st_size for path in written)


def is_interrupted(line: str, request: pytest.FixtureRequest) -> None:
    """Works, and ends on Ctrl-C as a command does; make has a code of its own."""
    (sign,) = (sign for begin, sign in SIGNS.items() if line.startswith(begin))
    ended = clone_of(request).interrupted(line, sign)
    assert ended.code in ((2, -signal.SIGINT) if line.startswith("make ") else (INTERRUPTED,)), ended.output
    assert "Traceback" not in ended.output


def is_run_after_training(line: str, request: pytest.FixtureRequest) -> None:
    """On what the documents' training leaves."""
    is_interrupted("make train", request)
    runs(line, request)


def reports(line: str, request: pytest.FixtureRequest) -> None:
    """On a recorded study, where the one that the documents run would leave its own."""
    place = clone_of(request).folder / "studies" / line.split()[-1]
    shutil.rmtree(place, ignore_errors=True)
    recorded_study.algorithms(place, seeds=(356, 567), domains=())
    runs(line, request)
    assert (place / "report" / "report.md").stat().st_size


def is_run_with_policy(line: str, request: pytest.FixtureRequest) -> None:
    """With the policy where the training that the documents show would leave it."""
    policy = clone_of(request).folder / shlex.split(line)[-1]
    policy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(DEFAULT, policy)
    runs(line, request)


def is_served(line: str, request: pytest.FixtureRequest) -> None:
    """The service that `service` starts."""
    assert re.fullmatch(r"127\.0\.0\.1:\d+", request.getfixturevalue("service"))
    options = cli.parser().parse_args(shlex.split(line)[1:])
    assert f"{options.host}:{options.port}" == SERVED


def is_answered(line: str, request: pytest.FixtureRequest) -> None:
    """By that service, with a mesh."""
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed")
    assert SERVED in line
    ended = clone_of(request).run(line.replace(SERVED, request.getfixturevalue("service")).replace("curl", "curl -sSf"))
    assert ended.code == 0, ended.output
    path = re.search(r" -o (\S+)", line)
    answer = (clone_of(request).folder / path[1]).read_text() if path else ended.output
    assert ("*ELEMENT" if "format=inp" in line else '"quads"') in answer


def is_dry(line: str, request: pytest.FixtureRequest) -> None:
    """Understood, with nothing done: a study, a submission."""
    dry = f"{line} --dry-run" if " study " in line.partition(" -- ")[0] else line.replace("submit", "submit --print")
    runs(dry, request)


def is_understood(line: str, request: pytest.FixtureRequest) -> None:
    """By the grammar of its program; settings are checked, too."""
    program, *words = [word for word in shlex.split(line) if not re.fullmatch(r"[A-Z_]+=\S*", word)]
    name = Path(program).name
    if name == "freemesh":
        options = cli.parser().parse_args(words)
        if options.command == "train":
            config.load(options.config, options.set)
    else:
        context = {"ray": click_lines.ray, "mlflow": click_lines.mlflow}[name]([name, *words])
        entry = context.params.get("entrypoint")
        if entry and entry[1].endswith(".py"):
            assert entry[0] == "python"  # of the reader's own
        elif entry:
            assert entry[:3] == ("python", "-m", "freemesh_ray")
            is_understood(shlex.join(["freemesh", *entry[3:]]), request)


def is_planned(line: str, request: pytest.FixtureRequest) -> None:
    """A target of the Makefile, whose programs are installed."""
    clone = clone_of(request)
    ended = clone.run(f"{line} --dry-run --always-make" if line == "make install" else f"{line} --dry-run")
    assert ended.code == 0, ended.output
    programs = set(re.findall(r"\.venv/bin/\S+", ended.output))
    assert programs
    assert all((clone.folder / program).exists() for program in programs)


def is_of_a_baseline(line: str, request: pytest.FixtureRequest) -> None:
    """Its options are the script's."""
    program, script, *words = shlex.split(line)
    ended = clone_of(request).run(f"{program} {script} --help")
    assert ended.code == 0, ended.output
    assert {word for word in words if word.startswith("--")} <= set(re.findall(r"--[\w-]+", ended.output))


def is_elsewhere(line: str, request: pytest.FixtureRequest) -> None:
    """Needs a program or a cluster that is not here: correct for the shell, and the files that it names are there."""
    clone = clone_of(request)
    ended = clone.run(f"bash -n -c {shlex.quote(line)}")
    assert ended.code == 0, ended.output
    for name in re.findall(r"(?<=[ =])deploy/[\w./-]+", line):
        place = clone.folder / name
        assert place.is_file() or (place / "kustomization.yaml").is_file(), name


#: The check of each command; the first that matches it whole.
CHECKS: list[tuple[str, Check]] = [
    (r"make train", is_interrupted),
    (r"make \w+", is_planned),
    (r"\.venv/bin/freemesh mesh .* --policy runs/\w+/policy\.npz", is_run_with_policy),
    (r"\.venv/bin/freemesh compare \S+ --match-elements", runs),
    (r"\.venv/bin/freemesh (mesh .*|domains|study|study \w+ --dry-run|convergence .*|--version)", runs),
    (r"\.venv/bin/freemesh study \w+ --smoke", is_dry),
    (r"\.venv/bin/freemesh (study algorithms|compare .*|paper quality)", is_interrupted),
    (r"\.venv/bin/freemesh report \w+", reports),
    (r"\.venv/bin/freemesh sync runs/default", is_run_after_training),
    (r"\.venv/bin/freemesh serve", is_served),
    (r"\.venv/bin/freemesh submit .*", is_dry),
    (r"\.venv/bin/freemesh (train .*|bench|study \w+ --(add|records) .*|report (--|\w+ ).*)", is_understood),
    (r"curl .*", is_answered),
    (r"([A-Z_]+=\S+ )?\.venv/bin/(mlflow|ray) .*|ray .*", is_understood),
    (r"\(umask .*|set -a; .*", runs),
    (r"\.venv/bin/python docs/examples/baselines/\w+\.py .*", is_of_a_baseline),
    (r"(docker|helm|kubectl) .*|export .*", is_elsewhere),
]


def check_of(line: str) -> Check | None:
    return next((check for pattern, check in CHECKS if re.fullmatch(pattern, line)), None)


def test_every_command_has_a_check() -> None:
    unknown = [f"{command}: {command.text}" for command in COMMANDS if check_of(command.text) is None]
    assert not unknown, "add it to one of CHECKS"
    assert len(COMMANDS) > 40
    assert check_of(".venv/bin/freemesh dance") is None


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_a_command_works(command: Code, request: pytest.FixtureRequest) -> None:
    check = check_of(command.text)
    assert check is not None
    check(command.text, request)


@pytest.mark.slow
def test_what_the_first_command_prints_is_in_the_readme(clone: Clone) -> None:
    """But for its milliseconds."""
    shown = next(block.text for block in blocks("README.md") if "quads in" in block.text)
    command = next(command.text for command in COMMANDS if " mesh " in command.text)
    timeless = [re.sub(r"\d+ ms", "ms", text.strip()) for text in (clone.run(command).output, shown)]
    assert timeless[0] == timeless[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "block", [block for document in documents() for block in blocks(document) if block.language == "python"], ids=str
)
def test_a_python_block_runs(block: Code, clone: Clone, blank_database: Path) -> None:
    """With the model in the registry that a study would have left there."""
    if "models:/" in block.text:
        shutil.copy(blank_database, clone.folder / "mlflow.db")
        (name,) = re.findall(r"models:/([\w-]+)@best", block.text)
        ended = clone.python(
            "from freemesh_ray.policies.policy import DEFAULT\nfrom freemesh_ray.tracking import register\n"
            f"register(DEFAULT, uri='sqlite:///mlflow.db', name={name!r})"
        )
        assert ended.code == 0, ended.output
    ended = clone.python(block.text)
    assert ended.code == 0, ended.output


@pytest.mark.parametrize(
    "code", [code for code in INLINE if re.match(r"(\.venv/bin/)?freemesh |make \w", code.text)], ids=str
)
def test_inline_commands_are_of_the_grammar(code: Code, clone: Clone) -> None:
    """They may leave arguments out, and name files that are not of the repository."""
    program, *words = shlex.split(code.text)
    if program == "make":
        assert clone.run(f"{code.text} --dry-run").code == 0
        return
    parser = cli.parser()
    if words[0] in cli.COMMANDS:
        (subparsers,) = (action for action in parser._actions if action.dest == "command")
        parser = subparsers.choices[words[0]]  # type: ignore[index]
        words = words[1:]
    assert {word for word in words if word.startswith("-")} <= set(parser._option_string_actions)
    config.load([words[i + 1] for i, word in enumerate(words) if word == "--config"],
                [words[i + 1] for i, word in enumerate(words) if word == "--set"])  # fmt: skip


def test_the_usage_of_serve_is_its_grammar() -> None:
    """Its options and their defaults, as docs/serving.md has them."""
    (block,) = (block for block in blocks("docs/serving.md") if block.text.startswith("freemesh serve"))
    told = dict(re.findall(r"\[--([\w-]+) (\S+)\]", block.text))
    defaults = {name.replace("_", "-"): value for name, value in vars(cli.parser().parse_args(["serve"])).items()}
    assert set(told) == set(defaults) - {"command"}
    for option, value in told.items():
        assert value in ("N", "FILE", "NAMES") or type(defaults[option])(value) == defaults[option], option
