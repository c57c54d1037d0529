"""Write data/croissant.json, the Croissant metadata of the builtin corpus (https://docs.mlcommons.org/croissant)."""

from __future__ import annotations

import gzip
import hashlib
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CORPUS, METADATA = ROOT / "data" / "builtin.jsonl.gz", ROOT / "data" / "croissant.json"
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
            }
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "entries",
                "name": "entries",
                "description": "an entry per statement; the first line, a header, has none of these fields. Start"
                " scenes, with labels, are nested under 'starts' in the file.",
                "field": [
                    {
                        "@type": "cr:Field",
                        "@id": f"entries/{name}",
                        "name": f"entries/{name}",
                        "description": description,
                        "dataType": data_type,
                        "source": {"fileObject": {"@id": CORPUS.name}, "extract": {"column": name}},
                    }
                    for name, (data_type, description) in FIELDS.items()
                ],
            }
        ],
    }


def text() -> str:
    return json.dumps(metadata(), indent=1) + "\n"


if __name__ == "__main__":
    METADATA.write_text(text(), encoding="utf-8")
    sys.stdout.write(f"{METADATA}\n")
