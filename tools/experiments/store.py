"""What was measured, on disk: a file for each repetition, so that an interrupted experiment goes on where it was."""
import json
import os
import pathlib
import platform
import re
import zlib


FORMAT = 1  # of an experiment's JSON: what report.py reads


def slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def write(file: pathlib.Path, value) -> None:
    """Whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(file.name + ".part")
    part.write_text(json.dumps(value, indent=1) + "\n")
    os.replace(part, file)


def read(file: pathlib.Path) -> dict | None:
    try:
        return json.loads(file.read_text())
    except (OSError, ValueError):
        return None


def repetition_file(out: pathlib.Path, experiment: str, case: str, seed: int) -> pathlib.Path:
    """Names that differ in their signs alone have files of their own."""
    return out / "repetitions" / experiment / f"{slug(case)}-{zlib.crc32(case.encode()):08x}-{seed}.json"


def kept(file: pathlib.Path, asked: dict) -> dict | None:
    """A repetition that was measured before, if it was asked for the very same, of the very same programs."""
    found = read(file)
    return found if isinstance(found, dict) and found.get("asked") == asked else None


def machine() -> dict:
    cpu = next((line.split(":", 1)[1].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
                if line.startswith("model name")), platform.machine())
    memory = int(re.search(r"MemTotal:\s+(\d+)", pathlib.Path("/proc/meminfo").read_text())[1])
    return {"cpu": cpu, "cores": len(os.sched_getaffinity(0)), "memory_gb": round(memory / 2**20, 1),
            "system": f"{platform.system()} {platform.release()}", "load_before": round(os.getloadavg()[0], 2)}
