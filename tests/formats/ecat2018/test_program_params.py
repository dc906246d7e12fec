"""The workspaces that ECAT knows."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import EcatError, FormatError
from ecat.formats.ecat2018.program_params import ProgramParams, read_program_params, write_program_params

paths = st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff"))


def test_a_settings_file_reads_as_ecat_wrote_it() -> None:
    params = ProgramParams(r"C:\Users\a & b", (r"C:\Users\a & b", r"D:\old"))
    written = write_program_params(params)
    assert written == (
        b"\xef\xbb\xbf"
        b'<?xml version="1.0" encoding="utf-8"?>\r\n'
        b"<ws>\r\n"
        b"  <defaultWorkspace>C:\\Users\\a &amp; b</defaultWorkspace>\r\n"
        b"  <recentWorkspaces>\r\n"
        b"    <workspace>C:\\Users\\a &amp; b</workspace>\r\n"
        b"    <workspace>D:\\old</workspace>\r\n"
        b"  </recentWorkspaces>\r\n"
        b"</ws>"
    )
    assert read_program_params(written) == params


@given(st.none() | paths, st.lists(paths).map(tuple))
def test_reading_written_settings_gives_them_back(default: str | None, recent: tuple[str, ...]) -> None:
    params = ProgramParams(default, recent)
    assert read_program_params(write_program_params(params)) == params


def test_another_document_is_refused() -> None:
    with pytest.raises(FormatError, match="the root is <session>"):
        read_program_params(b"<session/>")


@given(st.binary(max_size=60))
def test_any_bytes_give_settings_or_one_typed_error(data: bytes) -> None:
    with pytest.raises(EcatError):
        read_program_params(b"<ws>" + data)
