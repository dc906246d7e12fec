"""``schemas/ecat-2018.xsd`` describes every generation of ``files.param``, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

SCHEMA = etree.XMLSchema(etree.parse(Path(__file__).parents[3] / "schemas" / "ecat-2018.xsd"))

FACE = "<face><bounding>1,2,3.5,-4,5E-05,6,7,8</bounding><code>1 ,0 ,0 ,1 </code></face>"
OBJECT = (
    '<object id="o1" name="" filename="a.avi" objectType="3D" generate="TRACKED" color="-16777216" '
    'borderSize="1" semanticType="" shape="Annotator.GlyphBoxObject" own="x">'
    f'<markers><marker type="LOCATION" frame="0" glyphSize="2">{FACE}</marker>'
    '<marker type="DELETE" frame="5" /></markers>'
    '<markers3d><marker frame="0" glyphSize="2"><face><bounding>-∞,-∞,-∞</bounding><code>1 </code></face>'
    "</marker></markers3d></object>"
)
EVENT = (
    '<annotation id="a1"><duration startFrame="0" endFrame="9" /><text>Slide it\n</text>'
    '<refs><ref start="0" end="5" refTo="o1" /></refs><events>'
    '<event start="0" end="5" semanticType="Slide" /></events>'
    '<link><linkTo id="a2" type="SUBEVENT(X,Y)" /></link></annotation>'
)
PREDICATE = '<predicate frame="0" arguments="2" ids="o1,other/o2" q="True" type="IDENTITY(X,Y)" />'
SESSION = (
    '<session name="s" length="100" duration="3333" startWriteRGB="2017-10-04T22:35:30.583746Z">'
    f'<files><file>a.avi</file></files><objects no="1">{OBJECT}</objects>'
    f'<annotations no="1">{EVENT}</annotations><predicates>{PREDICATE}</predicates></session>'
)


def faults(document: str) -> str:
    SCHEMA.validate(etree.fromstring(document.encode()))
    return str(SCHEMA.error_log)


def test_real_files_of_both_lines_of_development_validate(shared: Path) -> None:
    paths = [*(shared / "ecat_kinect").glob("*/*/files.param")]
    paths += sorted((shared / "ecat_movies").rglob("files.param"))[::5]
    paths += (shared / "ecat_movies" / "SampleAnnotation").rglob("files.param")
    assert len(paths) > 400
    for path in paths:
        assert SCHEMA.validate(etree.parse(path)), f"{path}\n{SCHEMA.error_log}"


def test_the_newest_generation_validates() -> None:
    assert faults(SESSION) == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<annotations no="1">', "<annotations>"),
        (f"<predicates>{PREDICATE}</predicates>", ""),
        (' duration="3333" startWriteRGB="2017-10-04T22:35:30.583746Z"', ""),
        (
            "</markers3d>",
            '</markers3d><links><link frame="1"><linkTo id="o2" q="False" type="LOOK_AT"/></link></links>',
        ),
        (
            "</markers3d>",
            '</markers3d><links><link frame="1"><linkTo q="True" type="SIT(X)"/></link></links>',
        ),
        ("SUBEVENT(X,Y)", "SUBEVENT"),
        ("Annotator.GlyphBoxObject", "Rectangle"),
        ("TRACKED", "tracked"),
        (f'<objects no="1">{OBJECT}</objects>', '<objects no="0" />'),
        ('length="100"', 'length="-49"'),
    ],
    ids=lambda value: value[:40],
)
def test_older_generations_and_real_oddities_validate(old: str, new: str) -> None:
    assert old in SESSION
    assert faults(SESSION.replace(old, new)) == ""


def test_the_first_generation_without_wrappers_validates() -> None:
    body = (
        '<marker type="LOCATION" shape="Rectangle" frame="0">1,2,3,4</marker>'
        '<spatialLink frame="0"><linkTo id="o2" q="True" type="ON"/></spatialLink>'
    )
    start, end = OBJECT.index("<markers>"), OBJECT.index("</object>")
    first = OBJECT[:start] + body + OBJECT[end:]
    first = first.replace(' shape="Annotator.GlyphBoxObject"', "").replace("<object ", '<object scale="1" ')
    assert faults(SESSION.replace(OBJECT, first)) == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (' name="s"', ""),
        ('length="100"', 'length="many"'),
        ("22:35:30.583746Z", "22:35"),
        ("<file>a.avi</file>", "<file></file>"),
        (OBJECT, OBJECT + OBJECT),
        ('id="o1" name', "name"),
        ('objectType="3D"', 'objectType="4D"'),
        ('generate="TRACKED"', 'generate="GUESSED"'),
        ('color="-16777216"', 'color="red"'),
        ('borderSize="1"', 'borderSize="11"'),
        ('frame="5" />', 'frame="0" />'),
        ('type="DELETE" frame="5"', 'type="HIDE" frame="5"'),
        ('type="DELETE" frame="5"', 'type="DELETE"'),
        ("1,2,3.5,-4", "1;2;3.5;-4"),
        ("1 ,0 ,0 ,1 ", "1 ,0 ,2 ,1 "),
        ("<text>", "<words>x</words><text>"),
        ('<duration startFrame="0" endFrame="9" />', ""),
        ("<refs>", '<refs start="1">'),
        ('q="True"', 'q="yes"'),
        ('arguments="2"', 'arguments="3"'),
        ("IDENTITY(X,Y)", "IDENTITY"),
        ("<files>", "<files><folder/>"),
        ("<predicates>", "<relations/><predicates>"),
    ],
)
def test_broken_files_do_not_validate(old: str, new: str) -> None:
    assert old in SESSION
    assert faults(SESSION.replace(old, new, 1)) != ""
