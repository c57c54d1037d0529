"""/annotate: write programs for statements; the organisers' page manages the annotation."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal, get_args

from anyio.to_thread import run_sync
from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import AfterValidator, BaseModel, Field, StringConstraints
from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.corpus import CorpusError
from lilgym_mp.programs.syntax import MAX_LENGTH
from lilgym_mp.scene import Scene
from lilgym_mp.web import annotation, annotation_admin, language, statement_import, tutorial
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import (
    ANNOTATOR,
    CurrentCaller,
    CurrentOrganiser,
    CurrentPerson,
    add_person,
    find_other_person,
    issue_token,
)
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import RandomId, ShortText, SplitName, storable
from lilgym_mp.web.scene_body import SceneBody, scene_body
from lilgym_mp.web.store.models import Submission, TutorialAnswer
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

MAX_ROW_ID = 2**31 - 1
IMPORT_BATCH = 200  # statements stored at once; other writes take their turn in between
RowId = Annotated[int, Path(ge=1, le=MAX_ROW_ID)]
ProgramText = Annotated[str, StringConstraints(max_length=2 * MAX_LENGTH), AfterValidator(storable)]
DisplayName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=80, pattern=r"^[\w .,()-]+$")
]
SkipReason = Literal["ambiguous", "cannot be expressed", "wrong label", "not English", "too hard", "other"]


class ProgramBody(BaseModel):
    program: ProgramText


class DraftBody(BaseModel):
    """The editor's text, and the draft version it is based on."""

    program: ProgramText
    version: int = Field(ge=0, le=MAX_ROW_ID)


class SavedDraft(BaseModel):
    version: int


class NewSubmission(BaseModel):
    """A program; `key` is an idempotency key chosen by the client, so that a retry is stored once."""

    key: RandomId
    program: ProgramText
    confidence: int | None = Field(None, ge=1, le=5)
    comment: ShortText = ""
    question: ShortText = ""


class NewSkip(BaseModel):
    key: RandomId
    reason: SkipReason
    comment: ShortText = ""
    question: ShortText = ""


RoleName = Literal["annotator", "organiser"]


class NewPerson(BaseModel):
    name: DisplayName
    role: RoleName = ANNOTATOR


class RoleBody(BaseModel):
    role: RoleName


class TokenBody(BaseModel):
    """A person's login path, returned only once."""

    name: str
    path: str


class NewBatch(BaseModel):
    name: DisplayName
    people: list[Annotated[int, Field(ge=1, le=MAX_ROW_ID)]] = Field(max_length=1_000)
    statements: int = Field(20, ge=1, le=100_000)
    annotators_each: int = Field(1, ge=1, le=100)


class NewRedistribution(BaseModel):
    name: DisplayName
    people: list[Annotated[int, Field(ge=1, le=MAX_ROW_ID)]] = Field(max_length=1_000)


class CreatedBatch(BaseModel):
    id: int
    assignments: int


class NewReview(BaseModel):
    verdict: Literal["kept", "disputed", "rejected"]
    note: ShortText = ""


class ImportBody(BaseModel):
    """Result of an import: number of valid statements, of new ones, and of errors, with the first errors."""

    read: int
    added: int
    faults: int
    first_faults: list[str]


class TutorialTaskBody(BaseModel):
    name: str
    title: str
    statement: str
    advice: str
    label: bool
    scene: SceneBody
    hidden_scenes: int
    solved: bool


# Pages


@router.get("/annotate", include_in_schema=False)
def home_page(request: Request, caller: CurrentCaller) -> Response:
    return render_page(request, "annotate.html", is_organiser=caller.is_organiser)


@router.get("/annotate/guidelines", include_in_schema=False)
def guidelines_page(request: Request) -> Response:
    return render_page(request, "guidelines.html", language=language.language())


@router.get("/annotate/tutorial", include_in_schema=False)
def tutorial_page(request: Request, person: CurrentPerson) -> Response:
    return render_page(request, "annotate_tutorial.html")


@router.get("/annotate/organise", include_in_schema=False)
def organise_page(request: Request, person: CurrentOrganiser) -> Response:
    return render_page(request, "organise.html")


@router.get("/annotate/{assignment_id}", include_in_schema=False)
def work_page(request: Request, person: CurrentPerson, services: Services, assignment_id: RowId) -> Response:
    with services.database.read_session() as session:
        annotation.find_assignment(session, person, assignment_id)
    reasons = get_args(SkipReason)
    return render_page(request, "annotate_work.html", assignment_id=assignment_id, reasons=reasons)


# The language


@api.get("/language")
def words() -> language.LanguageBody:
    """All words of the program language, with signatures and documentation."""
    return language.language()


@api.post("/check")
def check(text: ProgramBody) -> language.CheckBody:
    """Checks the syntax of a program."""
    return language.check(text.program)


# Assignments and submissions of the annotator logged in


@api.get("/assignments")
def assignments(services: Services, person: CurrentPerson) -> list[annotation.AssignmentSummary]:
    with services.database.read_session() as session:
        return annotation.list_assignments(session, person)


@api.get("/assignments/{assignment_id}")
async def assignment(services: Services, person: CurrentPerson, assignment_id: RowId) -> annotation.AssignmentBody:
    """The statement, its shown scene and label, and the draft program."""

    def read() -> tuple[annotation.AssignmentBody, bool]:
        with services.database.read_session() as session:
            found = annotation.find_assignment(session, person, assignment_id)
            return annotation.assignment_body(session, person, found), found.assignment.opened is None

    body, is_new = await run_sync(read)
    if is_new:
        await services.database.write(lambda session: annotation.record_first_opening(session, assignment_id))
    return body


@api.put("/assignments/{assignment_id}/draft")
async def draft(services: Services, person: CurrentPerson, assignment_id: RowId, written: DraftBody) -> SavedDraft:
    """Saves the editor's text."""
    version = await services.database.write(
        lambda session: annotation.save_draft(session, person, assignment_id, written.program, written.version),
    )
    return SavedDraft(version=version)


@api.post("/assignments/{assignment_id}/run")
async def run(
    services: Services, person: CurrentPerson, assignment_id: RowId, written: ProgramBody
) -> annotation.RunBody:
    """Runs a program on the shown scene."""

    def read() -> tuple[Scene, bool]:
        with services.database.read_session() as session:
            shown = annotation.find_assignment(session, person, assignment_id).shown
        return Scene.from_json(shown.scene), shown.label

    scene, label = await run_sync(read)
    return await annotation.run_program(services.evaluator, person, written.program, scene, label=label)


@api.post("/assignments/{assignment_id}/submissions", status_code=201)
async def submit(
    services: Services, person: CurrentPerson, assignment_id: RowId, new: NewSubmission
) -> annotation.VerdictBody:
    """Submits a program that agrees with the shown scene; it is then checked on the hidden scenes."""

    def read() -> tuple[Submission | None, list[tuple[Scene, bool]], int]:
        with services.database.read_session() as session:
            found = annotation.find_assignment(session, person, assignment_id)
            stored = annotation.find_submission(session, assignment_id, new.key)
        labelled = [(Scene.from_json(row.scene), row.label) for row in found.scenes]
        return stored, labelled, found.assignment.shown

    submission, scenes, shown = await run_sync(read)
    if submission is None:
        verdict = await annotation.check_program(services.evaluator, person, new.program, scenes, shown)
        columns = new.model_dump(exclude={"key"})
        submission = await services.database.write(
            lambda session: annotation.store_submission(session, person, assignment_id, new.key, verdict, **columns)
        )
    return annotation.verdict_body(submission)


@api.post("/assignments/{assignment_id}/skip", status_code=201)
async def skip(services: Services, person: CurrentPerson, assignment_id: RowId, new: NewSkip) -> annotation.VerdictBody:
    """Skips the statement, with a reason."""
    verdict, columns = annotation.SKIPPED, new.model_dump(exclude={"key"})
    submission = await services.database.write(
        lambda session: annotation.store_submission(session, person, assignment_id, new.key, verdict, **columns)
    )
    return annotation.verdict_body(submission)


@api.get("/history")
def history(services: Services, person: CurrentPerson) -> list[annotation.SubmissionBody]:
    """Your submissions, with their reviews."""
    with services.database.read_session() as session:
        return annotation.submission_history(session, person)


# The tutorial


@api.get("/tutorial")
def tutorial_tasks(services: Services, person: CurrentPerson) -> list[TutorialTaskBody]:
    with services.database.read_session() as session:
        solved = set(session.scalars(select(TutorialAnswer.task).where(TutorialAnswer.person_id == person.id)))
    return [
        TutorialTaskBody(
            name=task.name,
            title=task.title,
            statement=task.statement,
            advice=task.advice,
            label=task.scenes[0][1],
            scene=scene_body(task.scenes[0][0]),
            hidden_scenes=len(task.scenes) - 1,
            solved=task.name in solved,
        )
        for task in tutorial.TASKS
    ]


def _tutorial_task(name: str) -> tutorial.TutorialTask:
    if name not in tutorial.TASKS_BY_NAME:
        raise http_error(404, f"no tutorial task {name!r}; choose from {', '.join(tutorial.TASKS_BY_NAME)}")
    return tutorial.TASKS_BY_NAME[name]


@api.post("/tutorial/{name}/run")
async def run_tutorial(
    services: Services, person: CurrentPerson, name: RandomId, written: ProgramBody
) -> annotation.RunBody:
    scene, label = _tutorial_task(name).scenes[0]
    return await annotation.run_program(services.evaluator, person, written.program, scene, label=label)


@api.post("/tutorial/{name}/submissions", status_code=201)
async def submit_tutorial(
    services: Services, person: CurrentPerson, name: RandomId, written: ProgramBody
) -> annotation.VerdictBody:
    task = _tutorial_task(name)
    verdict = await annotation.check_program(services.evaluator, person, written.program, task.scenes, 0)
    if verdict == annotation.ACCEPTED:
        answer = TutorialAnswer(person_id=person.id, task=name, program=written.program)
        await services.database.write(lambda session: session.merge(answer))
    return annotation.VerdictBody(id=0, verdict=verdict, message=annotation.VERDICT_MESSAGES[verdict])


# Administration by organisers


@api.post("/imports", openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}, "required": True}})
async def import_file(
    request: Request, services: Services, person: CurrentOrganiser, split: SplitName = "train"
) -> ImportBody:
    """Imports the file in the request's body: a corpus file, or NLVR's JSON lines, which are added to `split`."""
    data = await request.body()

    try:
        result = await run_sync(statement_import.read_statements, data, split)
    except CorpusError as fault:
        raise http_error(422, str(fault)) from None
    added = 0
    for first in range(0, len(result.statements), IMPORT_BATCH):
        batch = result.statements[first : first + IMPORT_BATCH]
        added += await services.database.write(partial(statement_import.store_statements, statements=batch))
    first_faults = result.faults[: statement_import.MAX_REPORTED_FAULTS]
    return ImportBody(read=len(result.statements), added=added, faults=len(result.faults), first_faults=first_faults)


@api.get("/people")
def people(services: Services, person: CurrentOrganiser) -> list[annotation_admin.PersonSummary]:
    with services.database.read_session() as session:
        return annotation_admin.list_people(session, person)


@api.post("/people", status_code=201)
async def new_person(services: Services, person: CurrentOrganiser, new: NewPerson) -> TokenBody:
    """Adds a person with a login link."""
    token = await services.database.write(lambda session: issue_token(add_person(session, new.name, new.role)))
    return TokenBody(name=new.name, path=f"/login?token={token}")


@api.post("/people/{person_id}/token", status_code=201)
async def new_token(services: Services, person: CurrentOrganiser, person_id: RowId) -> TokenBody:
    """Issues a new login link for a person, which ends the older link and all of the person's logins."""

    def replace_token(session: Session) -> tuple[str, str]:
        found = find_other_person(session, person, person_id)
        return found.name, issue_token(found)

    name, token = await services.database.write(replace_token)
    return TokenBody(name=name, path=f"/login?token={token}")


@api.put("/people/{person_id}/role", status_code=204)
async def change_role(services: Services, person: CurrentOrganiser, person_id: RowId, new: RoleBody) -> None:
    """Makes a person an annotator or an organiser."""

    def set_role(session: Session) -> None:
        find_other_person(session, person, person_id).role = new.role

    await services.database.write(set_role)


@api.delete("/people/{person_id}/token", status_code=204)
async def revoke(services: Services, person: CurrentOrganiser, person_id: RowId) -> None:
    """Revokes a person's token, which ends all of their logins."""

    def remove_token(session: Session) -> None:
        find_other_person(session, person, person_id).token_hash = None

    await services.database.write(remove_token)


@api.get("/batches")
def batches(services: Services, person: CurrentOrganiser) -> list[annotation_admin.BatchSummary]:
    with services.database.read_session() as session:
        return annotation_admin.list_batches(session)


@api.post("/batches", status_code=201)
async def create_batch(services: Services, person: CurrentOrganiser, new: NewBatch) -> CreatedBatch:
    """Assigns unassigned statements to people in turn."""
    batch, count = await services.database.write(
        lambda session: annotation_admin.create_batch(
            session, new.name, new.people, new.statements, new.annotators_each
        )
    )
    return CreatedBatch(id=batch.id, assignments=count)


@api.post("/redistributions", status_code=201)
async def redistribute(services: Services, person: CurrentOrganiser, new: NewRedistribution) -> CreatedBatch:
    """Assigns skipped and disputed statements to people who have not had them."""
    batch, count = await services.database.write(
        lambda session: annotation_admin.redistribute(session, new.name, new.people)
    )
    return CreatedBatch(id=batch.id, assignments=count)


@api.get("/reviews")
async def reviews(
    services: Services,
    person: CurrentOrganiser,
    first: Annotated[int, Query(ge=0, le=MAX_ROW_ID)] = 0,
    most: Annotated[int, Query(ge=1, le=100)] = 20,
) -> list[annotation_admin.StatementReview]:
    """Statements with their submissions, from id `first` on."""

    def read() -> list[annotation_admin.ComparedPrograms]:
        with services.database.read_session() as session:
            return annotation_admin.review_page(session, first, most)

    return await annotation_admin.with_agreement(services.evaluator, person, await run_sync(read))


@api.post("/submissions/{submission_id}/reviews", status_code=204)
async def review(services: Services, person: CurrentOrganiser, submission_id: RowId, new: NewReview) -> None:
    """Reviews a submission; its author sees the verdict and the note."""
    await services.database.write(
        lambda session: annotation_admin.add_review(session, person, submission_id, new.verdict, new.note)
    )


@api.get("/statistics")
def statistics(services: Services, person: CurrentOrganiser) -> annotation_admin.StatisticsBody:
    with services.database.read_session() as session:
        return annotation_admin.statistics(session)


@api.get("/export", response_class=Response)
def export(services: Services, person: CurrentOrganiser) -> Response:
    """The kept statements as a corpus file, which `lilgym-mp data check` accepts."""
    with services.database.read_session() as session:
        data = annotation_admin.export_corpus(session)
    headers = {"Content-Disposition": 'attachment; filename="annotated.jsonl"'}
    return Response(data, media_type="application/jsonl", headers=headers)


router.include_router(api)
