"""/annotate/organise: organisers manage people, batches and imports, review submissions, and export the programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, Literal, TypeVar

from anyio.to_thread import run_sync
from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field, StringConstraints
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from lilgym_mp.corpus import CorpusError
from lilgym_mp.web import statement_import
from lilgym_mp.web.app_services import AppServices, Services
from lilgym_mp.web.authentication import (
    ANNOTATOR,
    OPERATOR,
    CurrentOrganiser,
    add_person,
    find_other_person,
    issue_token,
)
from lilgym_mp.web.bodies import Body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import SplitName
from lilgym_mp.web.routes import annotate
from lilgym_mp.web.routes.annotate import MAX_ROW_ID, RowId
from lilgym_mp.web.routes.review import disputed_statements, skipped_statements, submission_records
from lilgym_mp.web.store.models import Assignment, Batch, Person, Statement, StatementScene, TutorialAnswer
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

T = TypeVar("T")

IMPORT_BATCH = 200  # statements stored at once; other writes take their turn in between
DisplayName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=80, pattern=r"^[\w .,()-]+$")
]


class RoleBody(BaseModel):
    role: Literal["annotator", "organiser"]


class NewPerson(RoleBody):
    name: DisplayName
    role: Literal["annotator", "organiser"] = ANNOTATOR


class TokenBody(BaseModel):
    """A person's login path, returned only once."""

    name: str
    path: str


class NewRedistribution(BaseModel):
    name: DisplayName
    people: list[Annotated[int, Field(ge=1, le=MAX_ROW_ID)]] = Field(max_length=1_000)


class NewBatch(NewRedistribution):
    statements: int = Field(20, ge=1, le=100_000)
    annotators_each: int = Field(1, ge=1, le=100)


class CreatedBatch(BaseModel):
    id: int
    assignments: int


class ImportBody(BaseModel):
    """Result of an import: number of valid statements, of new ones, and of errors, with the first errors."""

    read: int
    added: int
    faults: int
    first_faults: list[str]


class BatchSummary(Body):
    """A batch with the number of its assignments by state."""

    id: int
    name: str
    open: int
    done: int
    skipped: int


class PersonSummary(BatchSummary):
    """A person with assignment counts by state, and the number of tutorial tasks solved."""

    role: str
    has_token: bool
    is_fixed: bool  # the caller, or the organiser who starts the server: link and role cannot be changed here
    tutorial: int


@router.get("/annotate/organise", include_in_schema=False)
def organise_page(request: Request, person: CurrentOrganiser) -> Response:
    return render_page(request, "organise.html")


@api.post("/imports", openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}, "required": True}})
async def import_file(
    request: Request, services: Services, person: CurrentOrganiser, split: SplitName = "train"
) -> ImportBody:
    """Imports the file in the request's body: a corpus file, or NLVR's JSON lines, which are added to `split`."""
    data = await request.body()
    try:
        statements, faults = await run_sync(statement_import.read_statements, data, split)
    except CorpusError as fault:
        raise http_error(422, str(fault)) from None
    added = 0
    for first in range(0, len(statements), IMPORT_BATCH):
        batch = statements[first : first + IMPORT_BATCH]
        added += await services.database.write(partial(statement_import.store_statements, statements=batch))
    first_faults = faults[: statement_import.MAX_REPORTED_FAULTS]
    return ImportBody(read=len(statements), added=added, faults=len(faults), first_faults=first_faults)


# People


@api.get("/people")
def people(services: Services, person: CurrentOrganiser) -> list[PersonSummary]:
    answers = select(func.count()).where(TutorialAnswer.person_id == Person.id).scalar_subquery()
    query = (
        select(Person, answers.label("tutorial"), *_state_counts())
        .outerjoin(Assignment, Assignment.person_id == Person.id)
        .group_by(Person.id)
        .order_by(Person.name)
    )
    with services.database.read_session() as session:
        return [
            PersonSummary.of(
                found,
                has_token=found.token_hash is not None,
                is_fixed=found.id == person.id or found.name == OPERATOR,
                **counts,
            )
            for found, counts in ((row.Person, row._mapping) for row in session.execute(query))
        ]


def _state_counts() -> list[Any]:
    """Columns: the number of assignments in each state."""
    states = (annotate.STATE_OPEN, annotate.STATE_DONE, annotate.STATE_SKIPPED)
    return [func.count(Assignment.id).filter(Assignment.state == state).label(state) for state in states]


@api.post("/people", status_code=201)
async def new_person(services: Services, person: CurrentOrganiser, new: NewPerson) -> TokenBody:
    """Adds a person with a login link."""
    token = await services.database.write(lambda session: issue_token(add_person(session, new.name, new.role)))
    return TokenBody(name=new.name, path=f"/login?token={token}")


@api.post("/people/{person_id}/token", status_code=201)
async def new_token(services: Services, person: CurrentOrganiser, person_id: RowId) -> TokenBody:
    """Issues a new login link for a person, which ends the older link and all of the person's logins."""
    name, token = await _change(services, person, person_id, lambda found: (found.name, issue_token(found)))
    return TokenBody(name=name, path=f"/login?token={token}")


@api.put("/people/{person_id}/role", status_code=204)
async def change_role(services: Services, person: CurrentOrganiser, person_id: RowId, new: RoleBody) -> None:
    """Makes a person an annotator or an organiser."""
    await _change(services, person, person_id, lambda found: setattr(found, "role", new.role))


@api.delete("/people/{person_id}/token", status_code=204)
async def revoke(services: Services, person: CurrentOrganiser, person_id: RowId) -> None:
    """Revokes a person's token, which ends all of their logins."""
    await _change(services, person, person_id, lambda found: setattr(found, "token_hash", None))


async def _change(services: AppServices, organiser: Person, person_id: int, change: Callable[[Person], T]) -> T:
    """Applies `change` to another person; responds with 404 or 409 as `find_other_person`."""
    return await services.database.write(lambda session: change(find_other_person(session, organiser, person_id)))


# Batches


@api.get("/batches")
def batches(services: Services, person: CurrentOrganiser) -> list[BatchSummary]:
    query = (
        select(Batch.id, Batch.name, *_state_counts())
        .join(Assignment, Assignment.batch_id == Batch.id)
        .group_by(Batch.id, Batch.name)
        .order_by(Batch.id)
    )
    with services.database.read_session() as session:
        return [BatchSummary.of(row) for row in session.execute(query)]


@api.post("/batches", status_code=201)
async def create_batch(services: Services, person: CurrentOrganiser, new: NewBatch) -> CreatedBatch:
    """Assigns unassigned statements, in order of import, to people in turn."""

    def assign(session: Session) -> CreatedBatch:
        is_unassigned = Statement.id.not_in(select(Assignment.statement_id))
        query = select(Statement.id).where(is_unassigned).order_by(Statement.id).limit(new.statements)
        work = [(statement, new.annotators_each) for statement in session.scalars(query)]
        if not work:
            raise http_error(409, "every statement has been assigned; import more")
        return _assign(session, new, work)

    return await services.database.write(assign)


@api.post("/redistributions", status_code=201)
async def redistribute(services: Services, person: CurrentOrganiser, new: NewRedistribution) -> CreatedBatch:
    """Assigns each disputed statement, and each skipped by all of its annotators, to one more person."""

    def assign(session: Session) -> CreatedBatch:
        wanted = sorted({*skipped_statements(session), *disputed_statements(submission_records(session))})
        if not wanted:
            raise http_error(409, "no statement is skipped or disputed")
        return _assign(session, new, [(statement, 1) for statement in wanted])

    return await services.database.write(assign)


def _assign(session: Session, new: NewRedistribution, work: Sequence[tuple[int, int]]) -> CreatedBatch:
    """Creates a batch from `work`, pairs of a statement id and the number of annotators; round-robin over people.

    Responds with 409 if the name is taken or these people have had all of these statements, 422 for unknown people.
    """
    known = set(session.scalars(select(Person.id).where(Person.id.in_(new.people), Person.token_hash.is_not(None))))
    unknown = [person for person in new.people if person not in known]
    if not new.people:
        raise http_error(422, "choose at least one person")
    if unknown:
        raise http_error(422, f"unknown people, or without a token: {', '.join(map(str, unknown))}")
    if session.scalar(select(Batch.id).where(Batch.name == new.name)) is not None:
        raise http_error(409, f"a batch named {new.name!r} already exists")
    taken = {tuple(row) for row in session.execute(select(Assignment.statement_id, Assignment.person_id))}
    scene_counts = Counter(session.scalars(select(StatementScene.statement_id)))
    batch = Batch(name=new.name)
    session.add(batch)
    session.flush()
    people = list(dict.fromkeys(new.people))
    created, turn = 0, 0
    for statement, annotators in work:
        for _ in range(len(people)):
            if not annotators:
                break
            person = people[turn % len(people)]
            turn += 1
            if (statement, person) in taken:
                continue
            shown = (statement + created) % scene_counts[statement]
            session.add(Assignment(batch_id=batch.id, statement_id=statement, person_id=person, shown=shown))
            created += 1
            annotators -= 1
    if not created:
        raise http_error(409, "these people have already had all of these statements; choose others")
    session.flush()
    return CreatedBatch(id=batch.id, assignments=created)
