"""A second look at what people said: agreement of layers, and surveys."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Response

from ecat.annotate import agreement, surveys
from ecat.annotate.agreement.compare import Agreement
from ecat.annotate.agreement.objects import match_objects
from ecat.errors import EcatError, UsageError
from ecat.store.schemes import scheme_or_default
from ecat.store.surveys import read_answers, read_survey, survey_names
from ecat.web.answers import json_answer
from ecat.web.asked import AnswerShape
from ecat.web.shapes import AgreementShape, Json, SurveyAnswered, SurveyShape, SurveySummary
from ecat.web.site import Site, TheSession, TheSite

router = APIRouter(prefix="/api", tags=["second look"])
Rater = Annotated[str, Query(max_length=64)]


@router.get("/sessions/{sid}/agreement", response_model=AgreementShape)
def agree(opened: TheSession, layers: Annotated[str, Query(max_length=1000)]) -> Response:
    """How far two layers agree, as they are now, and each thing that they see differently."""
    session, names = opened.session, [name for name in layers.split(",") if name]
    if len(names) != 2:
        raise UsageError("cannot compare", where=f"{len(names)} layers, expected two", fix="?layers=ann,ben")
    edited = opened.layers
    first, second = (edited[name].layer if name in edited else session.layer(name) for name in names)
    n_frames, scheme = session.manifest.n_frames, scheme_or_default(session.path, first.scheme)
    found = Agreement((names[0], names[1]))
    found.add((first, second), n_frames, scheme)
    differing = agreement.disagreements(first, second, n_frames, scheme)
    return json_answer(
        {
            "layers": names,
            "revisions": {name: opened.revisions().get(name, 0) for name in names},
            "figures": agreement.figures(found),
            "objects": [[a, b] for a, (b, _) in match_objects(first.objects, second.objects).items()],
            "disagreements": [asdict(each) for each in differing],
        }
    )


@router.get("/surveys", response_model=list[SurveySummary])
def all_surveys(site: TheSite) -> Response:
    """The surveys of the project."""
    root = site.library.root
    found: list[dict[str, Any]] = []
    for name in survey_names(root):
        try:
            survey, said = read_survey(root, name), surveys.last_answers(read_answers(root, name))
        except EcatError as damaged:
            found.append(
                {"name": name, "question": f"{damaged.what}: {damaged.where}", "items": 0, "raters": {}}
            )
            continue
        raters = {answer.rater: 0 for answer in said}
        for answer in said:
            raters[answer.rater] += 1
        found.append(
            {"name": name, "question": survey.question, "items": len(survey.items), "raters": raters}
        )
    return json_answer(found)


@router.get("/surveys/{name}", response_model=SurveyShape)
def one_survey(site: TheSite, name: str, rater: Rater = "") -> Response:
    """A survey, without what is right, and what ``rater`` answered so far."""
    survey, ids = read_survey(site.library.root, name), _ids(site)
    items = [
        {
            "id": item.id,
            "session": ids.get(item.session),
            "start_frame": item.start_frame,
            "end_frame": item.end_frame,
        }
        for item in survey.items
    ]
    said = surveys.last_answers(read_answers(site.library.root, name))
    answers = {a.item: {"answer": a.answer, "comment": a.comment} for a in said if a.rater == rater}
    asked: dict[str, Any] = {
        field: getattr(survey, field) for field in ("name", "question", "kind", "least", "most")
    }
    return json_answer({**asked, "choices": list(survey.choices), "items": items, "answers": answers})


@router.post("/surveys/{name}", response_model=SurveyAnswered)
def answer_survey(site: TheSite, name: str, body: AnswerShape) -> Response:
    """Note an answer; it is on the disk when this is acknowledged."""
    given = surveys.answer(
        site.library.root, name, body.item, rater=body.rater, said=body.answer, comment=body.comment
    )
    return json_answer(
        {"item": given.item, "answer": given.answer, "comment": given.comment, "time": given.time}
    )


@router.get("/surveys/{name}/results", response_model=Json)
def survey_results(site: TheSite, name: str) -> Response:
    """How the answers agree with each other and with what is right."""
    return json_answer(surveys.summarize(site.library.root, name))


def _ids(site: Site) -> dict[str, str]:
    """The ids of the sessions by their way from the root."""
    root = site.library.root
    return {path.relative_to(root).as_posix(): sid for sid, path in site.library.find().items()}
