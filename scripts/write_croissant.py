"""Write data/croissant.json, the Croissant metadata of the builtin corpus (https://docs.mlcommons.org/croissant)."""

from __future__ import annotations

import gzip
import hashlib
import json
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.writing import task_rows, write_lines

ROOT = Path(__file__).resolve().parents[1]
CORPUS, METADATA = ROOT / "data" / "builtin.jsonl.gz", ROOT / "data" / "croissant.json"
ROWS = "builtin-tasks.jsonl"
PUBLISHED = "2026-11-22"
TEXT = "sc:Text"
FIELDS = {  # field: type, description
    "id": (TEXT, "unique in the file, such as tower-train-001"),
    "appearance": (TEXT, "tower or scatter"),
    "split": (TEXT, "train, dev or test"),
    "statement": (TEXT, "English sentence about three boxes with objects"),
    "program": (TEXT, "executable meaning of the statement"),
    "tags": (TEXT, "hand-written, or the generator's level; in dev and test, whether the form occurs in train"),
}
ROW_FIELDS = {
    **{name: FIELDS[name] for name in ("id", "appearance", "split", "statement", "program")},
    "start": (TEXT, "scratch, from the empty scene, or flipit"),
    "target": ("sc:Boolean", "the truth value that the statement shall get"),
}
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    **{
        name: f"cr:{name}"
        for name in (
            "column",
            "equivalentProperty",
            "extract",
            "field",
            "fileProperty",
            "fileObject",
            "fileSet",
            "format",
            "includes",
            "isLiveDataset",
        )
    },
    **{name: f"cr:{name}" for name in ("jsonPath", "key", "md5", "parentField", "path", "recordSet", "references")},
    **{
        name: f"cr:{name}"
        for name in ("regex", "repeated", "replace", "samplingRate", "separator", "source", "subField", "transform")
    },
    "citeAs": "cr:citeAs",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
}


def metadata() -> dict[str, Any]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    contents = CORPUS.read_bytes()
    with TemporaryDirectory() as place:
        write_lines(Path(place) / ROWS, task_rows(load_all_tasks("builtin")))
        exported = (Path(place) / ROWS).read_bytes()
    header = json.loads(gzip.decompress(contents).split(b"\n", 1)[0])
    sections = ", ".join(f"{count} {name}" for name, count in header["sections"].items())
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": "lilgym_mp-builtin-corpus",
        "description": "Statements about images of three boxes, each with an executable program and labelled start"
        f" scenes, for reinforcement learning. Statements: {sections}. 300 were written one by one, the others by a"
        " generator; none was collected from annotators. This is neither lilGym's data nor NLVR's: it serves the"
        " environments of lilGym (https://arxiv.org/abs/2211.01994) where that data is not at hand.",
        "license": "https://spdx.org/licenses/MIT.html",
        "version": project["version"],
        "datePublished": PUBLISHED,
        "creator": {"@type": "sc:Organization", "name": "the authors of lilgym_mp"},
        "citeAs": "CITATION.cff",
        "rai:dataCollection": "Written and generated for this project; no data of or from persons.",
        "rai:dataLimitations": "English; two synthetic worlds; most statements follow the rules of one generator.",
        "rai:dataUseCases": "Training and evaluation of agents when the official lilGym corpus is not at hand.",
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": CORPUS.name,
                "name": CORPUS.name,
                "description": "gzipped JSON lines: a header, then an entry per line",
                "contentUrl": CORPUS.name,
                "contentSize": f"{len(contents)} B",
                "encodingFormat": "application/jsonlines",
                "sha256": hashlib.sha256(contents).hexdigest(),
            },
            {
                "@type": "cr:FileObject",
                "@id": ROWS,
                "name": ROWS,
                "description": f"JSON lines, as written by: lilgym-mp data export builtin --out {ROWS}",
                "contentUrl": ROWS,
                "contentSize": f"{len(exported)} B",
                "encodingFormat": "application/jsonlines",
                "sha256": hashlib.sha256(exported).hexdigest(),
            },
        ],
        "recordSet": [
            _record_set(
                "entries",
                "an entry per statement; the first line, a header, has none of these fields. Start scenes, with labels,"
                " are nested under 'starts' in the file.",
                CORPUS.name,
                FIELDS,
            ),
            _record_set(
                "tasks",
                "a row per task of both appearances, all splits and starts; 'scene', three lists of items, and 'tags'"
                " are nested",
                ROWS,
                ROW_FIELDS,
            ),
        ],
    }


def _record_set(name: str, description: str, file: str, fields: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": description,
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{column}",
                "name": f"{name}/{column}",
                "description": meaning,
                "dataType": data_type,
                "source": {"fileObject": {"@id": file}, "extract": {"column": column}},
            }
            for column, (data_type, meaning) in fields.items()
        ],
    }


def text() -> str:
    return json.dumps(metadata(), indent=1) + "\n"


if __name__ == "__main__":
    METADATA.write_text(text(), encoding="utf-8")
    sys.stdout.write(f"{METADATA}\n")
