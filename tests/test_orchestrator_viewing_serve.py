"""Serving recordings: what browsers ask of a server before they read a file piece by piece."""

import json
from contextlib import contextmanager
from http.client import HTTPConnection
from threading import Thread

import pytest
from fake_system import flight, helicopter, tell
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.command.app import status
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.viewing import view
from orchestrator.viewing.layout import NAME
from orchestrator.viewing.serve import HOST, File, Server, span

CONTENT = bytes(range(256)) * 1000


@contextmanager
def serving(files):
    """Run a server of files while the block runs."""
    with Server(files) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    path = tmp_path_factory.mktemp("serve") / "a b.mcap"
    path.write_bytes(CONTENT)
    files = {path.name: File("application/octet-stream", path), "x": File("text/plain", b"")}
    with serving(files) as made:
        yield made


def ask(server, method="GET", path="/a%20b.mcap", **headers):
    """Return status, headers and body."""
    connection = HTTPConnection(HOST, server.server_port, timeout=10)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers, body


def test_a_file_comes_whole(server):
    """Status 200, its length, and that ranges are possible."""
    status, headers, body = ask(server)
    assert (status, body) == (200, CONTENT)
    assert headers["Content-Length"] == f"{len(CONTENT)}"
    assert headers["Accept-Ranges"] == "bytes"
    assert headers["Content-Type"] == "application/octet-stream"


@pytest.mark.parametrize(
    ("asked", "first", "stop"),
    [("bytes=0-0", 0, 1), ("bytes=70000-199999", 70000, 200000), ("bytes=255999-", 255999, 256000),
     ("bytes=-5", 255995, 256000), ("bytes=10-9999999", 10, 256000)],
)  # fmt: skip
def test_a_range_comes_alone(server, asked, first, stop):
    """Status 206 with just these bytes and where they are."""
    status, headers, body = ask(server, Range=asked)
    assert (status, body) == (206, CONTENT[first:stop])
    assert headers["Content-Range"] == f"bytes {first}-{stop - 1}/{len(CONTENT)}"


@pytest.mark.parametrize("asked", ["bytes=256000-", "bytes=5-4", "bytes=-0"])
def test_a_range_of_nothing_is_refused(server, asked):
    """Status 416 with the size there is."""
    status, headers, body = ask(server, Range=asked)
    assert (status, body) == (416, b"")
    assert headers["Content-Range"] == f"bytes */{len(CONTENT)}"


def test_pages_of_other_origins_may_read(server):
    """Every answer, a refusal too, allows any origin and shows it lengths and ranges."""
    asked = (("GET", "/a%20b.mcap"), ("HEAD", "/x"), ("GET", "/none"), ("OPTIONS", "/x"))
    for method, path in asked:
        _, headers, _ = ask(server, method, path)
        assert headers["Access-Control-Allow-Origin"] == "*"
        assert "Range" in headers["Access-Control-Allow-Headers"]
        assert {"Content-Length", "Content-Range", "Accept-Ranges"} <= {
            name.strip() for name in headers["Access-Control-Expose-Headers"].split(",")
        }


def test_a_head_is_an_answer_without_its_body(server):
    """HEAD tells length and type of GET; OPTIONS tells nothing but what is allowed."""
    status, headers, body = ask(server, "HEAD")
    assert (status, headers["Content-Length"], body) == (200, f"{len(CONTENT)}", b"")
    assert ask(server, "OPTIONS")[0] == 204


@pytest.mark.parametrize("path", ["/", "/none", "/../a b.mcap", "/%2e%2e/etc/passwd", "/a b.mcap/"])
def test_only_what_was_named_is_served(server, path):
    """No path leads elsewhere in the file system."""
    assert ask(server, path=path.replace(" ", "%20"))[0] == 404


def test_other_methods_are_refused(server):
    """Nothing can be written."""
    assert ask(server, "POST")[0] == 501


@given(st.integers(0, 300), st.integers(0, 300) | st.none(), st.integers(0, 300) | st.none())
@settings(deadline=None)
def test_spans_are_slices(size, first, last):
    """What a Range header asks for is a slice of the file, or nothing."""
    if first is None and last is None:
        assert span("bytes=-", size) == range(size)
        return
    start, end = ("" if end is None else f"{end}" for end in (first, last))
    asked = f"bytes={start}-{end}"
    everything = range(size)
    if first is None:
        expected = everything[max(size - last, 0) :]
    else:
        expected = everything[first:] if last is None else everything[first : last + 1]
    assert (span(asked, size) or range(0)) == expected


@pytest.mark.parametrize("asked", [None, "bytes=0-1,3-4", "lines=1-2", "nonsense", "bytes=-"])
def test_what_is_not_understood_gets_everything(asked):
    """As one may answer what is not one range of bytes."""
    assert span(asked, 10) == range(10)


def test_a_recording_is_served_with_its_layout(tmp_path, monkeypatch):
    """What is printed leads to both files, for Lichtblick in one address."""
    system = helicopter(cells=2, capacity=3, posts=2)
    tell(Recorder(tmp_path / "f.mcap"), system, flight(system, 0.2))
    said, got = [], {}

    def forever(server):
        thread = Thread(target=Server.__mro__[1].serve_forever, args=(server, 0.01))
        thread.start()
        for name in ("f.mcap", NAME):
            got[name] = ask(server, path=f"/{name}")[2]
        server.shutdown()
        thread.join()
        raise KeyboardInterrupt

    monkeypatch.setattr(Server, "serve_forever", forever)
    view.serve(Recording.open(tmp_path / "f.mcap"), 0, said.append)
    assert got["f.mcap"] == (tmp_path / "f.mcap").read_bytes()
    assert "configById" in json.loads(got[NAME])
    text = "\n".join(said)
    assert "ds=remote-file&ds.url=http%3A%2F%2F127.0.0.1%3A" in text
    assert "f.mcap" in text
    assert NAME in text


@pytest.mark.parametrize(
    ("options", "installed", "wanted"),
    [
        (["--web", "--serve"], True, "view: got --serve and --web, expected one of them"),
        (["--web"], False, "--web: rerun is not installed, expected `pip install rerun-sdk`"),
        ([], True, "view: no display for a window, expected one, --web or --serve"),
    ],
)
def test_what_cannot_be_shown_is_one_line(
    tmp_path, capsys, monkeypatch, options, installed, wanted
):
    """Two ways at once, a package that is missing, a window where there is no display."""
    system = helicopter(cells=2, capacity=3, posts=2)
    tell(Recorder(tmp_path / "f.mcap"), system, flight(system, 0.2))
    monkeypatch.setattr(view, "has_rerun", lambda: installed)
    monkeypatch.setattr(view.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert status(["view", str(tmp_path / "f.mcap"), *options]) == 2
    assert capsys.readouterr().err == f"{wanted}\n"
