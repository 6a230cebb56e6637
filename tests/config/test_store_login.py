"""A store's password is no part of settings, whoever gave them, and goes with the address that it was given for."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from envs.errors import UserError
from envs.printable import without_login
from freemesh_ray import config
from freemesh_ray.cli import command
from freemesh_ray.config.paths import STORE, Paths
from freemesh_ray.config.store_login import LOGINS, known, remember, set_aside, with_login
from freemesh_ray.studies.definition import load
from freemesh_ray.studies.runner import folder_of

PASSWORD = "s3cr3tpw"
FULL, BARE = f"http://alice:{PASSWORD}@host:5000/mlflow", "http://host:5000/mlflow"
STUDY = {"study": {"title": "Two", "seeds": [1], "variants": {"near": None, "far": {"learner.gamma": 0.9}}}}

words = st.text(st.characters(exclude_categories=("Z", "C")), min_size=1, max_size=20)
#: A user, or a password, as it may stand in an address.
logins = words.filter(lambda word: not set(word) & set("/?#\\"))
hosts = st.from_regex(r"[a-z]{1,8}(\.[a-z]{1,8})?(:[0-9]{2,5})?(/[a-z]{1,8})?", fullmatch=True)


@pytest.fixture(autouse=True)
def nothing_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LOGINS, "{}")
    monkeypatch.delenv(STORE, raising=False)


@given(words, words, hosts, st.sampled_from(["http", "https", "postgresql+psycopg2"]))
def test_an_address_is_shown_without_its_login(user: str, password: str, host: str, scheme: str) -> None:
    address = f"{scheme}://{user}:{password}@{host}"
    assert without_login(address) == f"{scheme}://{host}"
    assert (
        without_login(f"say {address} or '{address}' to me@home")
        == f"say {scheme}://{host} or '{scheme}://{host}' to me@home"
    )
    assert str(UserError(f"{address}: is away")).startswith(f"{scheme}://{host}: ")


@given(words)
def test_what_is_no_login_stays(text: str) -> None:
    for plain in (text.replace("://", ""), f"sqlite:////home/a@b/{text}", f"http://host/{text.replace('@', '')}"):
        assert without_login(plain) == plain


def test_it_takes_time_with_the_length_of_the_text() -> None:
    """A million letters take a fraction of a second; with the square of them it would be hours."""
    for text in ("a://" * 250_000, "a" * 1_000_000 + "@://", "a://@" * 200_000, "a" * 1_000_000):
        without_login(text)


@given(logins, logins, hosts)
def test_a_login_goes_with_its_own_address_alone(user: str, password: str, host: str) -> None:
    login = f"{user}:{password}"
    bare = set_aside(f"https://{login}@{host}")
    assert bare == f"https://{host}"
    assert urlsplit(with_login(bare).replace(login, "x")).netloc == f"x@{urlsplit(bare).netloc}"
    assert with_login(bare) == f"https://{login}@{host}"
    for other in (f"http://{host}", f"https://{host}x", f"https://x{host}", f"{bare}/deeper", "sqlite:///mlflow.db"):
        assert with_login(other) == other


@given(hosts, hosts, st.sampled_from("/?#\\"), words)
def test_no_address_becomes_another_host(host: str, other: str, sign: str, path: str) -> None:
    """An @ behind the host is no login: whoever wrote it would have the data, and the login, sent elsewhere."""
    for address in (f"http://{host}{sign}{path}@{other}", f"http://u:{PASSWORD}@{host}{sign}{path}@{other}"):
        bare = set_aside(address)
        assert bare.startswith(f"http://{host}{sign}")
        with pytest.raises(UserError) as told:
            config.check(bare, config.SCHEMA["tracking.uri"], "mine.yaml", "tracking.uri")
        assert PASSWORD not in str(told.value)


@pytest.mark.parametrize(
    "login",
    [f"u:{PASSWORD} w", f"u:{PASSWORD}/a b", f"u:{PASSWORD}/w", f"u:{PASSWORD}?w", f"u:{PASSWORD}#", "u:p@" + PASSWORD],
)
def test_a_password_is_not_shown_by_a_refusal(login: str) -> None:
    address = set_aside(f"http://{login}@host name/x")
    with pytest.raises(UserError) as told:
        config.check(address, config.SCHEMA["tracking.uri"], "mine.yaml", "tracking.uri")
    assert PASSWORD not in str(told.value)


@pytest.mark.parametrize(
    "address", ["http://h", "https://h.example:5000/a/b?c=d#e", "http://[::1]:5000", "sqlite:///a@b.db"]
)
def test_addresses_of_stores_are_taken(address: str) -> None:
    assert config.check(set_aside(address), config.SCHEMA["tracking.uri"], "mine.yaml", "tracking.uri") == address


def test_another_process_can_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    set_aside(FULL)
    told = known()
    monkeypatch.setenv(LOGINS, "no JSON")
    assert known() == {}
    assert with_login(BARE) == BARE
    remember(told)
    assert with_login(BARE) == FULL


@pytest.mark.parametrize("way", ["set", "file", "mapping", "environment"])
def test_no_tree_of_settings_has_it(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.yaml").write_text(f"tracking: {{uri: '{FULL}'}}")
    if way == "environment":
        monkeypatch.setenv(STORE, FULL)
    overlays = {"file": [tmp_path / "mine.yaml"], "mapping": [{"tracking.uri": FULL}]}.get(way, [])
    paths = Paths.from_environment()
    tree = paths.resolved(config.load(overlays, [f"tracking.uri={FULL}"] if way == "set" else []))
    assert tree["tracking"]["uri"] == BARE
    assert PASSWORD not in config.dump(tree)
    assert with_login(BARE) == FULL
    assert paths.resolved(tree) == tree
    tree["tracking"]["uri"] = FULL  # who makes a tree by hand
    assert paths.resolved(tree)["tracking"]["uri"] == BARE


@pytest.mark.slow
@pytest.mark.parametrize("way", ["set", "settings", "variant"])
def test_no_definition_of_a_study_has_it(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FREEMESH_HOME", str(tmp_path))
    about = yaml.safe_load(yaml.safe_dump(STUDY))
    if way == "settings":
        about["settings"] = {"tracking.uri": FULL}
    if way == "variant":
        about["study"]["variants"]["near"] = {"tracking.uri": FULL}
    study = load(about, [f"tracking.uri={FULL}"] if way == "set" else [])
    assert study.trial_config("near", 1)["tracking"]["uri"] == BARE
    folder = folder_of(study)
    folder.make()
    folder.claim(study, resume=False)
    assert PASSWORD not in folder.definition.read_text()
    assert BARE in folder.definition.read_text()
    assert with_login(BARE) == FULL
    # One that was begun before passwords were left out goes on.
    folder.definition.write_text(folder.definition.read_text().replace(BARE, FULL))
    assert folder.claim(study, resume=True).tree() == study.tree()


@pytest.mark.parametrize("value", [
    f"ftp://alice:{PASSWORD}@host", f"http://alice:{PASSWORD}@", f"http://alice:{PASSWORD}/more@host/@", f"[http://a:{PASSWORD}@host",
])  # fmt: skip
def test_no_message_has_it(value: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert command.main(["train", "--set", f"tracking.uri={value}"]) == 2
    (tmp_path / "a.yaml").write_text(f"tracking:\n  uri: {value}\n")
    assert command.main(["train", "--config", str(tmp_path / "a.yaml")]) == 2
    assert command.main(["sync", str(tmp_path), "--uri", value]) == 2
    assert command.main(["train", "--set", f"tracking.url={value}"]) == 2
    out = capsys.readouterr()
    assert PASSWORD not in out.out + out.err
    assert out.err.count("\n") == 4


def test_a_job_s_line_takes_none(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever sees the cluster's dashboard would see it."""
    (tmp_path / "freemesh_ray").mkdir()
    (tmp_path / "deploy").mkdir()
    (tmp_path / "deploy" / "runtime_env.yaml").write_text("{}")
    monkeypatch.chdir(tmp_path)
    for line in (
        ["--tracking", FULL, "--", "train"],
        ["--tracking", BARE, "--", "train", "--set", f"tracking.uri={FULL}"],
    ):
        assert command.main(["submit", "--print", *line]) == 2
        out = capsys.readouterr()
        assert "MLFLOW_TRACKING_PASSWORD" in out.err
        assert PASSWORD not in out.out + out.err
    assert command.main(["submit", "--print", "--tracking", BARE, "--", "train"]) == 0
    assert BARE in capsys.readouterr().out
