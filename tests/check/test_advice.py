"""Every finding says what to do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ecat.check
from ecat.check.advice import ADVICE, advice
from ecat.check.finding import warning
from ecat.cli.app import app

CODE = re.compile(r'(?:error|warning|note|report|_unreadable)\(\s*"([a-z]+(?:-[a-z]+)*)"')
SOURCES = Path(ecat.check.__file__).parent.glob("*.py")
CODES = {code for file in SOURCES for code in CODE.findall(file.read_text("utf-8"))}


def test_there_is_advice_for_every_code_and_for_no_other() -> None:
    assert len(CODES) > 30
    assert ADVICE.keys() == CODES


@pytest.mark.parametrize("code", sorted(CODES))
def test_the_commands_in_it_exist_and_name_the_folder(code: str) -> None:
    text = advice(warning(code, "", ""), Path("my session"))
    for verb, arguments in re.findall(r"ecat ([a-z]+) (.*?)(?:; |, then: |$)", text):
        assert verb in app.commands or verb in app.list_commands(
            app.make_context("ecat", ["--help"], resilient_parsing=True)
        )
        assert "'my session'" in arguments or arguments == "RECORDING NEW_FOLDER"


def test_what_can_be_repaired_says_how() -> None:
    assert advice(warning("leftover", "", "", "remove it"), Path("s")) == "ecat check s --repair"
