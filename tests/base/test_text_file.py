"""Text files: encodings, what is no file, and the limit that comes before reading."""

import os
import socket
import tracemalloc

import pytest

from lapwing.base import text_file
from lapwing.base.text_file import TextFileError, decimal_number, read_text

TEXT = "µ = 1\nΔφ\n"


def put(tmp_path, data):
    path = tmp_path / "text"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(tmp_path, encoding, end):
    path = put(tmp_path, TEXT.replace("\n", end).encode(encoding))
    assert read_text(path, 100, "") == TEXT


@pytest.mark.parametrize(("data", "line", "column", "byte"), [
    ("a\nµ µ".encode() + b"\xb5\n", 2, 4, "not UTF-8 text, byte 0xb5"),
    ("a\r\nb".encode("utf-16") + b"\x00\xdc", 2, 2, "not UTF-16 text, byte 0x00"),
    (b"a\r\rb\0", 3, 2, "byte 0x00"),
    ("a".encode("utf-16-le"), 1, 2, "byte 0x00"),
])
def test_no_text(tmp_path, data, line, column, byte):
    with pytest.raises(TextFileError, match=byte) as caught:
        read_text(put(tmp_path, data), 100, "")
    assert (caught.value.line, caught.value.column) == (line, column)


def make_loop(path):
    path.symlink_to(path)


def make_socket(path):
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(path))


@pytest.mark.parametrize(("make", "words"), [
    (os.mkdir, "a folder; expected a file"), (os.mkfifo, "a named pipe; expected a file"),
    (make_socket, "a socket; expected a file"),
    (lambda path: path.symlink_to("/dev/zero"), "a device; expected a file"),
    (make_loop, "symbolic links that lead in a circle"), (lambda path: None, "no such file"),
])
def test_no_file(tmp_path, monkeypatch, make, words):
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "x")
    with pytest.raises(OSError) as caught:
        read_text("x", 100, "")
    assert caught.value.strerror == words


def test_a_pipe_put_in_place_of_a_file_does_not_block(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "x")
    file = os.stat(__file__)
    monkeypatch.setattr(text_file.os, "stat", lambda path: file)
    with pytest.raises(OSError, match="a named pipe"):
        read_text(tmp_path / "x", 100, "")


def test_no_permission(tmp_path, monkeypatch):
    path = put(tmp_path, b"x")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(text_file.os, "open", refuse)
    with pytest.raises(PermissionError) as caught:
        read_text(path, 100, "")
    assert caught.value.strerror == "no permission to read it"


def test_a_large_file_is_not_read(tmp_path):
    path = tmp_path / "large"
    with path.open("wb") as stream:
        stream.truncate(2**31)
    tracemalloc.start()
    try:
        with pytest.raises(TextFileError, match="2147483648 bytes; expected at most 100: why"):
            read_text(path, 100, "why")
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="no /proc")
def test_a_file_that_hides_its_size_is_limited():
    with pytest.raises(TextFileError, match="expected at most 100"):
        read_text("/proc/self/status", 100, "")


@pytest.mark.parametrize(("text", "number", "remark"), [
    ("1", 1, ""), ("+1.", 1, ""), (".5", .5, ""), ("1e-3", 1e-3, ""), ("1D-3", 1e-3, ""),
    ("0e-999", 0, ""), ("9" * 300, 1e300, ""),
    ("1_0", None, ""), ("٢", None, ""), ("1e", None, ""), ("", None, ""), ("0x1", None, ""),
    ("1 ", None, ""), ("nan", None, "NaN and infinity"), ("-Infinity", None, "NaN and infinity"),
    ("1e999", None, "too large"), ("9" * 10**6, None, "too large"), ("1e-999", None, "too small"),
    ("\u22121", None, "the minus sign"),
])
def test_numbers(text, number, remark):
    found, why = decimal_number(text)
    assert found == number
    assert remark in why
    assert bool(why) == bool(remark)
